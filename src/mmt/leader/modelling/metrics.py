"""Metrics of the modelling for Prometheus."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.leader.modelling.stage import Figures
    from mmt.leader.run_log import RunLog


def modelling_metrics(tasks: "dict[str, Figures]", log: "RunLog") -> Iterator["Metric"]:
    """Yield the figures of the model, and of each task that makes it."""
    from mmt.core.exposition import counter, gauge, labelled

    seconds = list(log.update_seconds)
    yield counter("model_updates", "Updates of the model.", len(seconds))
    yield counter("model_update_seconds", "Time spent on updates.", sum(seconds))
    yield gauge("model_samples", "Samples in the model.", log.update.samples if log.update else 0)
    if log.update is not None:
        yield gauge("model_distance", "Completion distance.", log.update.distance)
        value = log.update.progress.value
        yield gauge("model_completion", "What the completion criterion in use says.", value)
    if log.surfaces is not None:
        yield gauge("surface", "Number of the surface under the tool.", log.surfaces.current)
        yield gauge("surfaces_known", "Surfaces that were told apart.", log.surfaces.known)
    for name, text, values in (
        ("task_items", "Items that a task of the modelling has worked on.", "items"),
        ("task_dropped_items", "Items that found no room in a task's queue.", "drops"),
    ):
        yield labelled(name, text, "task", {k: getattr(t, values) for k, t in tasks.items()})
    for name, text, values in (
        ("task_queue_items", "Items that wait for a task of the modelling.", "queue_now"),
        ("task_queue_most_items", "Most items that have waited for it.", "queue_most"),
        ("task_median_seconds", "Median time that an item has taken.", "median_s"),
        ("task_longest_seconds", "Longest time that an item has taken.", "longest_s"),
    ):
        yield labelled(
            name, text, "task", {k: getattr(t, values) for k, t in tasks.items()}, grows=False
        )
    dropped = tasks["segmenting"].drops
    yield counter("modelling_dropped_frames", "Frames that found no room.", dropped)
