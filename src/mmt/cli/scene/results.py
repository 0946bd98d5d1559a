"""Results of measuring a scene: figures as JSON values, and remarks on their limits."""

import statistics
import sys
from collections.abc import Iterable, Mapping
from typing import Any, Final

from mmt.cli.scene.costs import FIGURES, SceneCosts
from mmt.cli.scene.description import Stream, describe_scene
from mmt.scene import Scene

_AT_ONCE: Final = 0.1
"""Share of a run: a model that drives the vibration earlier counts as used from the start."""


def packages_of(modules: Iterable[str]) -> list[str]:
    """Return the packages of modules, without the standard library, mmt and private packages."""
    tops = {name.partition(".")[0] for name in modules}
    return sorted(
        (
            name
            for name in tops - sys.stdlib_module_names - {"mmt"}
            if not name.startswith("_") and name.isidentifier()
        ),
        key=str.lower,
    )


def service_figures(costs: SceneCosts, service: str) -> dict[str, Any]:
    """Return costs, tasks, threads and imports of one service of the whole scene."""
    runs = [run.services[service] for run in costs.whole]
    modules = runs[0].modules
    return {
        **{name: summary_of(costs.values(service, name)) for name in FIGURES},
        "modules": len(modules),
        "import_s": sum(costs.import_s[service].values()),
        "packages": packages_of(modules),
        "tasks": _seen(run.tasks for run in runs),
        "threads": _seen(run.threads for run in runs),
        "system_threads": max(run.system_threads for run in runs),
    }


def summary_of(values: list[float]) -> dict[str, float]:
    """Return mean, least and largest value."""
    return {"mean": statistics.fmean(values), "least": min(values), "most": max(values)}


def part_figures(costs: SceneCosts, name: str, scene: Scene) -> dict[str, Any]:
    """Return the cost of a part in each service, and the bytes per second that it adds."""
    variant = costs.variants[name]
    result: dict[str, Any] = {
        "left_out": list(variant.left_out),
        "bytes_per_s": added_bytes_per_s(scene, variant.scene),
    }
    for service in costs.services:
        part = costs.part(name, service)
        result[service] = {
            **{
                figure: {
                    "difference": d.value,
                    "half_width": d.half_width,
                    "seen": d.is_significant,
                }
                for figure, d in part.figures.items()
            },
            "modules": len(part.modules),
            "packages": packages_of(part.modules),
            "import_s": part.import_s,
        }
    return result


def added_bytes_per_s(scene: Scene, without: Scene) -> dict[str, float]:
    """Return by direction how much more a scene sends than without a part, as computed."""
    whole, rest = (
        {stream.way: stream.bytes_per_s for stream in describe_scene(s).streams}
        for s in (scene, without)
    )
    return {way: value - rest.get(way, 0.0) for way, value in whole.items()}


def measured_bytes_per_s(costs: SceneCosts, stream: Stream) -> float:
    """Return the bytes per second of a stream's direction that the link counted, mean over runs."""
    return statistics.fmean(run.bytes_per_s[stream.way] for run in costs.whole)


def remarks(costs: SceneCosts, scene: Scene) -> list[str]:
    """Return sentences on the limits of the figures."""
    duration_s = scene.session.duration_s
    sentences = [f"{name}: not measured, {why}" for name, why in costs.failed.items()]
    if costs.kept and costs.without:
        sentences.append(
            f"{', '.join(costs.kept)}: cannot be left out of this scene, "
            "so what they cost by themselves is not known"
        )
    if scene.rendering is not None:
        began_s = [run.model_from_s for run in costs.whole if run.model_from_s is not None]
        if not began_s:
            sentences.append(
                f"rendering: no model was in use within {duration_s:g} s, so its share of a core "
                "is not in the figures; take a longer --duration"
            )
        elif min(began_s) > _AT_ONCE * duration_s:
            sentences.append(
                f"rendering: a model was in use from {min(began_s):.1f} s on, of {duration_s:g} s"
            )
    sentences += _generator_remarks([run.generator for run in costs.whole if run.generator])
    if costs.without:
        sentences.append(
            "parts share what they import and do: their costs need not add up to the whole's"
        )
    if scene.link is not None:
        sentences.append(
            "bytes: pings and the headers of WebSocket, TCP and IP are not counted; where ticks "
            "were missed, frames share a message and commands are left out"
        )
    return sentences


def _generator_remarks(runs: list[Mapping[str, Any]]) -> list[str]:
    """Return sentences on the costs of another package's generator, and its faults."""
    if not runs:
        return []

    def mean(key: str) -> float:
        return statistics.fmean([run.get(key) or 0.0 for run in runs])

    return [
        f"generator {runs[0]['name']}: its two processes take {mean('core_share'):.2f} of a core "
        f"and {mean('memory_mb'):.0f} MB beside the leader's; a block of 10 ms "
        f"{mean('block_p50_ms'):.2f} ms (p99 {mean('block_p99_ms'):.2f}), a fit "
        f"{mean('fit_median_ms'):.1f} ms",
        *sorted({run["fault"] for run in runs if run["fault"]}),
    ]


def costs_as_dict(costs: SceneCosts, scene: Scene) -> dict[str, Any]:
    """Return all results as JSON values."""
    streams = describe_scene(scene).streams
    return {
        "runs": len(costs.whole),
        "duration_s": scene.session.duration_s,
        "services": {service: service_figures(costs, service) for service in costs.services},
        "bytes_per_s": {stream.way: measured_bytes_per_s(costs, stream) for stream in streams},
        "parts": {name: part_figures(costs, name, scene) for name in costs.without},
        "remarks": remarks(costs, scene),
    }


def _seen(runs: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return by name the largest share, over runs, of samples in which it was seen."""
    most: dict[str, float] = {}
    for run in runs:
        for name, share in run.items():
            most[name] = round(max(share, most.get(name, 0.0)), 2)
    return dict(sorted(most.items()))
