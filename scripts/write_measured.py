"""Write the figures of ``mmt demo --json`` into the documentation; see ``scripts/measure``."""

import json
import re
import sys
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
README: Final = ROOT / "README.md"
PERFORMANCE: Final = ROOT / "docs" / "explanation" / "performance.md"

Row = tuple[str, str]


def main() -> None:
    """Replace what stands between the marks."""
    figures = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    model, services = model_rows(figures["evaluation"]), service_rows(figures)
    replace(README, ("figure", "measured"), [*model[:4], *services[:4]])
    replace(PERFORMANCE, ("figure", "measured"), [*model, *services])


def model_rows(evaluation: dict[str, Any]) -> list[Row]:
    """Say how good the model was."""
    start, stop, end = (evaluation[name] for name in ("at_start", "at_stop", "at_end"))
    scores = (start, stop, end)
    held_out = f"{stop['gfc']:.3f}, ceiling {stop['gfc_ceiling']:.3f}"
    return [
        (
            "start, stop criterion met after",
            f"{start['time_s']:.1f} s ({start['samples']} samples), "
            f"{stop['time_s']:.1f} s ({stop['samples']} samples)",
        ),
        (
            "power error against the known texture at start, stop, end",
            ", ".join(f"{score['power_error_db']:.2f}" for score in scores) + " dB rms",
        ),
        (
            "share of the plane within one just noticeable difference, likewise",
            ", ".join(f"{100 * score['within_jnd']:.0f}" for score in scores) + " %",
        ),
        ("GFC of held-out segments at stop", held_out),
        (
            "GFC against the known texture at start, stop, end",
            ", ".join(f"{score['truth_gfc']:.3f}" for score in scores),
        ),
        ("autoregressive order, chosen from the data", str(evaluation["order"])),
        ("evaluation, times faster than real time", f"{evaluation['times_real_time']:.0f}"),
    ]


def service_rows(figures: dict[str, Any]) -> list[Row]:
    """Say what the run cost, and what it lost."""
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


def replace(page: Path, columns: Row, rows: list[Row]) -> None:
    """Put a table between the marks of a page."""
    lines = [f"| {left} | {right} |" for left, right in (columns, ("---", "---"), *rows)]
    table = "\n".join(lines)
    text, count = re.subn(
        r"(<!-- measured: begin -->\n).*?(\n<!-- measured: end -->)",
        lambda match: f"{match[1]}{table}{match[2]}",
        page.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    if count != 1:
        raise SystemExit(f"{page}: the marks of the measured table stand there {count} times")
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
