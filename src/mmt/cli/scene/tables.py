"""Tables of a scene and its costs, for people."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from rich.table import Table

from mmt.cli.scene.costs import FIGURES
from mmt.cli.scene.description import SceneDescription, SideParts, Stream
from mmt.core.tables import plain_table

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


def wire_table(description: SceneDescription, bytes_per_s: Mapping[str, float]) -> Table:
    """Return a table of the streams: sizes as computed, and the rates that the link counted."""
    table = plain_table("On the wire")
    table.add_column("way")
    table.add_column("carries", ratio=1)
    for name in ("bytes each", "message bytes", "messages /s", "kB /s"):
        table.add_column(_stacked(name), justify="right")
    if bytes_per_s:
        table.add_column("kB/s\nmeasured", justify="right")
    for stream in description.streams:
        table.add_row(
            stream.way,
            _carried(stream),
            str(stream.record_bytes),
            str(stream.message_bytes),
            f"{stream.messages_per_s:.0f}",
            f"{stream.bytes_per_s / 1e3:.1f}",
            *([f"{bytes_per_s[stream.way] / 1e3:.1f}"] if bytes_per_s else []),
        )
    return table


def _carried(stream: Stream) -> str:
    count, holds = stream.records_per_message, ", ".join(stream.holds)
    return f"{stream.event}{f', {count} a message' if count > 1 else ''}: {holds}"


def whole_table(measured: Mapping[str, Any]) -> Table:
    """Return a table of the whole scene's services, of `SceneCosts.as_dict`."""
    runs, duration_s = measured["runs"], measured["duration_s"]
    table = plain_table(f"The whole scene: mean of {runs} runs of {duration_s:g} s, least and most")
    table.add_column("")
    services = measured["services"]
    for service in services:
        table.add_column(service, ratio=1, overflow="fold")
    for name in FIGURES:
        table.add_row(_LABELS[name], *(_mean(f[name], _DIGITS[name]) for f in services.values()))
    table.add_row("modules", *(str(f["modules"]) for f in services.values()))
    table.add_row("packages", *(", ".join(f["packages"]) for f in services.values()))
    return table


def _mean(value: Mapping[str, float], digits: int) -> str:
    least, mean, most = (f"{value[name]:.{digits}f}" for name in ("least", "mean", "most"))
    return f"{mean} ({least} to {most})"


def part_tables(measured: Mapping[str, Any]) -> Iterable[Table]:
    """Yield a table of the parts' costs for the leader, and one of what the follower sends for."""
    for service in measured["services"]:
        parts = {
            name: part
            for name, part in measured["parts"].items()
            if service == "leader" or part["bytes_per_s"].get("up")
        }
        if parts:
            yield _part_table(parts, service, sends=len(measured["services"]) > 1)


def _part_table(parts: Mapping[str, Any], service: str, *, sends: bool) -> Table:
    table = plain_table(f"What a part costs the {service}: with it less without it")
    table.add_column("part", ratio=1, vertical="bottom")
    labels = [*_LABELS.values(), *(["up kB/s"] if sends else []), "own modules"]
    for label in labels:
        table.add_column(_stacked(label), justify="right", vertical="bottom")
    for name, part in parts.items():
        figures, sent = part[service], part["bytes_per_s"].get("up")
        table.add_row(
            name,
            *(_difference(figures[figure], _DIGITS[figure]) for figure in FIGURES),
            *([f"{sent / 1e3:.1f}" if sent else "-"] if sends else []),
            str(figures["modules"] or "-"),
        )
    return table


def _difference(cost: Mapping[str, float], digits: int) -> str:
    value = f"{cost['difference']:.{digits}f}" if cost["seen"] else "≈0"
    return f"{value} ±{cost['half_width']:.{digits}f}"


def _stacked(name: str) -> str:
    return name.replace(" ", "\n", 1)
