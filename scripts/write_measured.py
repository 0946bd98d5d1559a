"""Write measured figures into the documentation; see ``scripts/measure``.

Usage: write_measured.py DEMO.json SCENES. DEMO.json has the figures of ``mmt demo --json``; the
folder SCENES has those of ``mmt scene explain --json``, in a file for each example scene.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
SCENES: Final = ROOT / "docs" / "reference" / "example-scenes.md"
PERFORMANCE: Final = ROOT / "docs" / "explanation" / "performance.md"

Row = tuple[str, ...]

SCENE_COLUMNS: Final = (
    "scene",
    "parts",
    "for",
    "leader: start, core, memory",
    "follower: start, core, memory",
    "up, down",
)
WRITTEN_COLUMNS: Final = 3
"""Columns of the scenes' table that people write; the rest is measured."""


def main() -> None:
    """Replace the tables between the marks of the pages."""
    write_scenes(Path(sys.argv[2]))
    figures = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    model, services = model_rows(figures["evaluation"]), service_rows(figures)
    replace(PERFORMANCE, "measured", ("figure", "measured"), [*model, *services])


def write_scenes(folder: Path) -> None:
    """Put the figures of every example scene behind the columns that people write.

    A scene that could not be measured keeps the figures that it has.
    """
    rows = []
    for cells in table_rows(SCENES, "scenes"):
        name = cells[0].partition("`")[2].partition("`")[0]
        file = folder / f"{name}.json"
        measured: Row = tuple(cells[WRITTEN_COLUMNS:]) or ("-",) * 3
        if file.exists():
            measured = scene_figures(json.loads(file.read_text(encoding="utf-8"))["measured"])
        rows.append((*cells[:WRITTEN_COLUMNS], *measured))
    replace(SCENES, "scenes", SCENE_COLUMNS, rows)


def scene_figures(measured: dict[str, Any]) -> Row:
    """Return the cost of both services, and the traffic over the wire."""
    services, wire = measured["services"], measured["bytes_per_s"]
    sides = (_side(services.get(name)) for name in ("leader", "follower"))
    sent = [f"{wire[way] / 1e3:.0f}" if way in wire else "0" for way in ("up", "down")]
    return (*sides, f"{', '.join(sent)} kB/s" if wire else "-")


def _side(service: dict[str, Any] | None) -> str:
    if service is None:
        return "-"
    start_s = service["start_s"]["least"]  # other programs' load only adds to it
    core, memory_mb = (service[name]["mean"] for name in ("core_share", "memory_mb"))
    return f"{start_s:.1f} s, {core:.2f}, {memory_mb:.0f} MB"


def model_rows(evaluation: dict[str, Any]) -> list[Row]:
    """Return rows on the errors of the model."""
    found = {name: evaluation[f"at_{name}"] for name in ("start", "stop", "end")}
    scores = {name: score for name, score in found.items() if score is not None}
    names, last = ", ".join(scores), next(name for name in scores if name != "start")
    return [
        ("start, stop criterion met after", f"{_met(found['start'])}, {_met(found['stop'])}"),
        (
            f"power error at {names}, over the strokes made; over the whole plane",
            "; ".join(
                ", ".join(f"{score[name]:.2f}" for score in scores.values()) + " dB rms"
                for name in ("power_error_db", "plane_power_error_db")
            ),
        ),
        (
            "share within one just noticeable difference, likewise",
            "; ".join(
                ", ".join(f"{100 * score[name]:.0f}" for score in scores.values()) + " %"
                for name in ("within_jnd", "plane_within_jnd")
            ),
        ),
        (
            f"GFC of held-out segments at {last}",
            f"{scores[last]['gfc']:.3f}, ceiling {scores[last]['gfc_ceiling']:.3f}",
        ),
        (
            f"GFC against the known texture at {names}",
            ", ".join(f"{score['truth_gfc']:.3f}" for score in scores.values()),
        ),
        ("autoregressive order", str(evaluation["order"])),
        ("evaluation, times faster than real time", f"{evaluation['times_real_time']:.0f}"),
    ]


def _met(score: dict[str, Any] | None) -> str:
    return "never" if score is None else f"{score['time_s']:.1f} s ({score['samples']} samples)"


def service_rows(figures: dict[str, Any]) -> list[Row]:
    """Return rows on the cost and the losses of the run."""
    leader, follower = figures["leader"], figures["follower"]
    link, ticks, texture = leader["link"], leader["ticks"], leader["texture"]
    played = leader["vibration"]["actuator"]["samples"]
    return [
        ("frames lost, samples played", f"{link['lost']} of {link['frames']}, {played}"),
        (
            "leader's tick: period p50, p99; share over 1 ms late",
            f"{ticks['period_p50_ms']:.2f}, {ticks['period_p99_ms']:.2f} ms; "
            f"{100 * ticks['late_share_1ms']:.1f} %",
        ),
        (
            "model update: median, longest",
            f"{texture['update_median_ms']:.0f}, {texture['update_longest_ms']:.0f} ms",
        ),
        ("leader, follower: share of a core; memory", _cost(leader, follower)),
        (
            "follower's tick: period p50, p99; share over 1 ms late",
            f"{follower['ticks']['period_p50_ms']:.2f}, "
            f"{follower['ticks']['period_p99_ms']:.2f} ms; "
            f"{100 * follower['ticks']['late_share_1ms']:.1f} %",
        ),
        ("ticks rendered together with a later one (leader)", str(ticks["missed"])),
        (
            "frames, one way: p50, p99",
            f"{link['latency_p50_ms']:.2f}, {link['latency_p99_ms']:.2f} ms",
        ),
        (
            "commands, one way: p50, p99",
            f"{follower['link']['latency_p50_ms']:.2f}, "
            f"{follower['link']['latency_p99_ms']:.2f} ms",
        ),
        ("leader ready after", f"{leader['process']['ready_s']:.1f} s"),
    ]


def _cost(leader: dict[str, Any], follower: dict[str, Any]) -> str:
    shares = [f"{side['process']['core_share']:.2f}" for side in (leader, follower)]
    memory = [f"{side['process']['memory_mb']:.0f}" for side in (leader, follower)]
    return f"{', '.join(shares)}; {', '.join(memory)} MB"


def between(page: Path, mark: str) -> re.Match[str]:
    """Find the text between the marks of a page."""
    text = page.read_text(encoding="utf-8")
    pattern = rf"(<!-- {mark}: begin -->\n)(.*?)(\n<!-- {mark}: end -->)"
    found = list(re.finditer(pattern, text, flags=re.DOTALL))
    if len(found) != 1:
        raise SystemExit(f"{page}: the marks of the table {mark!r} stand there {len(found)} times")
    return found[0]


def table_rows(page: Path, mark: str) -> list[list[str]]:
    """Return the cells of a table's rows, its heading left out."""
    lines = between(page, mark)[2].splitlines()[2:]
    return [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]


def replace(page: Path, mark: str, columns: Row, rows: list[Row]) -> None:
    """Put a table between the marks of a page."""
    table = "\n".join(f"| {' | '.join(row)} |" for row in (columns, ("---",) * len(columns), *rows))
    found = between(page, mark)
    before, after = found.string[: found.start()], found.string[found.end() :]
    page.write_text(f"{before}{found[1]}{table}{found[3]}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
