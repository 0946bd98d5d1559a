"""The leader's metrics and health, from what it counts anyway."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, get_args

from mmt.leader.backfill import Backfill
from mmt.leader.rendering import Mode

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.leader.service import LeaderService
    from mmt.link.http import Page

_MODES: Final[tuple[str, ...]] = get_args(Mode)


def pages(service: "LeaderService") -> "list[Page]":
    """Return what the leader serves beside its link: health, and metrics if the scene says so.

    Raises
    ------
    InputError
        The scene wants metrics and prometheus-client is not installed.
    """
    from mmt.link.http import health_page, metrics_page

    served = [health_page(lambda: health(service))]
    if service.scene.metrics is not None:
        from mmt.core.exposition import registry_of

        served.append(metrics_page(registry_of(lambda: collect(service))))
    if service.monitor is not None:
        served.append(service.monitor.page)
    return served


def health(service: "LeaderService") -> dict[str, Any]:
    """Return phase, session and faults; a fault is a sentence."""
    status = service.status()
    return {
        "phase": status.phase,
        "connected": service.remote is not None and service.remote.connected,
        "session": service.log.session_id,
        "time_s": round(status.time_s, 3),
        "mode": status.mode,
        "faults": service.faults(),
    }


def collect(service: "LeaderService") -> Iterator["Metric"]:
    """Yield the leader's metrics; called in a thread, about a millisecond."""
    from mmt.core.exposition import counter, gauge, link_metrics, session, state, tick_metrics

    status = service.status()
    yield session(service.log.session_id, "leader")
    yield gauge("session_time_seconds", "Session time.", status.time_s)
    if service.remote is not None and service.remote.server is not None:
        server = service.remote.server
        yield gauge("connected", "Whether a follower is connected.", server.connected)
        yield from link_metrics(server.statistics, server.latency)
        yield from _backfill(service.remote.backfill)
    yield from tick_metrics(service.ticker.statistics, service.ticker.periods)
    if service.parts.switch is not None:
        yield state("vibration_mode", "What drives the actuator.", "mode", status.mode, _MODES)
    yield from _model(service)
    if status.playout_delay_ms is not None:
        yield gauge(
            "playout_delay_seconds", "Delay of the playout buffer.", status.playout_delay_ms / 1e3
        )
    for device in service.parts.may_be_lost:
        yield gauge(f"{device.what}_lost", f"Whether the {device.what} is lost.", device.lost)
        yield counter(f"{device.what}_losses", f"Losses of the {device.what}.", device.losses)
    recorder = service.parts.recorder
    if recorder is not None:
        yield counter("recorded_frames", "Frames in the recording.", recorder.frames)
        yield counter("recording_dropped_frames", "Frames that found no room.", recorder.dropped)


def _backfill(backfill: Backfill) -> Iterator["Metric"]:
    from mmt.core.exposition import counter, gauge

    frames = backfill.missing.summary
    yield counter("missing_frames", "Frames that were missing at their turn.", frames["missing"])
    yield counter("filled_frames", "Missing frames that were filled in.", frames["filled"])
    yield counter("unfilled_frames", "Missing frames that were given up.", frames["lost"])
    yield gauge("awaited_frames", "Missing frames that may still come.", frames["waiting"])


def _model(service: "LeaderService") -> Iterator["Metric"]:
    from mmt.core.exposition import counter, gauge, labelled

    modelling, log = service.parts.modelling, service.log
    if modelling is None:
        return
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
    tasks = modelling.figures
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
    yield counter(
        "modelling_dropped_frames", "Frames that found no room.", modelling.dropped_frames
    )
