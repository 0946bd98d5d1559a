"""Tables of a scene and its costs, for people."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from rich.table import Table

from mmt.cli.scene.costs import FIGURES, CostDifference, SceneCosts
from mmt.cli.scene.description import SceneDescription, SideParts, Stream
from mmt.cli.scene.results import (
    added_bytes_per_s,
    measured_bytes_per_s,
    service_figures,
)
from mmt.core.tables import plain_table
from mmt.scene import Scene

_AT_TIMES: Final = 0.3
_DIGITS: Final = {"start_s": 2, "core_share": 2, "memory_mb": 1}
_LABELS: Final = {"start_s": "start (s)", "core_share": "core share", "memory_mb": "memory (MB)"}


def parts_table(description: SceneDescription) -> Table:
    """Return a table of the parts that run in each service, and those left out."""
    table = plain_table("Parts")
    for name in ("service", "runs", "tasks", "left out"):
        table.add_column(name, ratio=None if name == "service" else 1)
    for name, side in (("leader", description.leader), ("follower", description.follower)):
        table.add_row(name, *_sides(side))
    return table


def _sides(side: SideParts | None) -> tuple[str, str, str]:
    """Return the parts that run, the tasks, and the parts that are left out."""
    if side is None:
        return "none in this scene", "", ""
    texts = (", ".join(names) for names in (side.runs, side.tasks, side.left_out))
    runs, tasks, left_out = texts
    return runs or "nothing", tasks, left_out or "nothing"


def wire_table(description: SceneDescription, costs: SceneCosts | None) -> Table:
    """Return a table of the streams: sizes as computed, and the rates that the link counted."""
    table = plain_table("On the wire")
    table.add_column("way")
    table.add_column("carries", ratio=1)
    for name in ("bytes each", "message bytes", "messages /s", "kB /s"):
        table.add_column(_stacked(name), justify="right")
    if costs is not None:
        table.add_column("kB/s\nmeasured", justify="right")
    for stream in description.streams:
        measured = () if costs is None else (f"{measured_bytes_per_s(costs, stream) / 1e3:.1f}",)
        table.add_row(
            stream.way,
            _carried(stream),
            str(stream.record_bytes),
            str(stream.message_bytes),
            f"{stream.messages_per_s:.0f}",
            f"{stream.bytes_per_s / 1e3:.1f}",
            *measured,
        )
    return table


def _carried(stream: Stream) -> str:
    count, holds = stream.records_per_message, ", ".join(stream.holds)
    return f"{stream.event}{f', {count} a message' if count > 1 else ''}: {holds}"


def whole_table(costs: SceneCosts, scene: Scene) -> Table:
    """Return a table of costs, imports, tasks and threads of the whole scene's services."""
    runs, duration_s = len(costs.whole), scene.session.duration_s
    table = plain_table(f"The whole scene: mean of {runs} runs of {duration_s:g} s, least and most")
    table.add_column("")
    figures = {service: service_figures(costs, service) for service in costs.services}
    for service in figures:
        table.add_column(service, ratio=1, overflow="fold")
    for name in FIGURES:
        table.add_row(_LABELS[name], *(_mean(f[name], _DIGITS[name]) for f in figures.values()))
    table.add_row(
        "imports",
        *(f"{f['modules']} modules in {f['import_s']:.2f} s" for f in figures.values()),
    )
    table.add_row("packages", *(", ".join(f["packages"]) for f in figures.values()))
    table.add_row("tasks", *("\n".join(_seen(f["tasks"])) for f in figures.values()))
    table.add_row("threads", *("\n".join(_threads(f)) for f in figures.values()))
    return table


def _mean(value: Mapping[str, float], digits: int) -> str:
    least, mean, most = (f"{value[name]:.{digits}f}" for name in ("least", "mean", "most"))
    return f"{mean} ({least} to {most})"


def _seen(seen: Mapping[str, float]) -> list[str]:
    """Return names, marked "(at times)" if seen in a small share of samples."""
    return [name if share > _AT_TIMES else f"{name} (at times)" for name, share in seen.items()]


def _threads(figures: Mapping[str, Any]) -> list[str]:
    return [*_seen(figures["threads"]), f"{figures['system_threads']} in all, as the system counts"]


def part_tables(costs: SceneCosts, scene: Scene) -> Iterable[Table]:
    """Yield a table of parts' costs for each service, for the follower if it sends more."""
    added = {
        name: added_bytes_per_s(scene, costs.variants[name].scene).get("up", 0.0)
        for name in costs.without
    }
    for service in costs.services:
        names = [name for name in costs.without if service == "leader" or added[name]]
        if names:
            yield _part_table(costs, service, {name: added[name] for name in names})


def _part_table(costs: SceneCosts, service: str, added: Mapping[str, float]) -> Table:
    table = plain_table(f"What a part costs the {service}: with it less without it")
    table.add_column("part", ratio=1, vertical="bottom")
    for figure in FIGURES:
        table.add_column(_stacked(_LABELS[figure]), justify="right", vertical="bottom")
    sent = ("up kB/s",) if len(costs.services) > 1 else ()
    for name in (*sent, "own modules", "import (s)"):
        table.add_column(_stacked(name), justify="right", vertical="bottom")
    for name, bytes_per_s in added.items():
        part = costs.part(name, service)
        table.add_row(
            name,
            *(_difference(d, _DIGITS[figure]) for figure, d in part.figures.items()),
            *((f"{bytes_per_s / 1e3:.1f}" if bytes_per_s else "-",) if sent else ()),
            str(len(part.modules) or "-"),
            f"{part.import_s:.2f}" if part.modules else "-",
        )
    return table


def _difference(difference: CostDifference, digits: int) -> str:
    value = f"{difference.value:.{digits}f}" if difference.is_significant else "≈0"
    return f"{value} ±{difference.half_width:.{digits}f}"


def _stacked(name: str) -> str:
    return name.replace(" ", "\n", 1)
