"""What a report answers at a glance: four tiles and a sentence."""

from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import Any, Final

from mmt.evaluation.document import Block, Paragraph, Tile, Tiles
from mmt.evaluation.results import Evaluation
from mmt.evaluation.texts import number, share
from mmt.texture.settings import JND_DB

_LATE_SHARE: Final = 0.05
"""Share of ticks over 1 ms late from which on a run is degraded."""


def at_a_glance(evaluations: Sequence[Evaluation], run: Mapping[str, Any]) -> list[Block]:
    """Return what a report begins with; of several sessions the medians."""
    if not evaluations:
        return [Tiles([_health([], run)])]
    error_db = _middle(each.final.power_error_db for each in evaluations)
    tiles = [
        _vibration(evaluations),
        _readiness(evaluations),
        Tile(
            "error of the level", f"{number(error_db, 1)} dB", f"just noticeable: {JND_DB:.2f} dB"
        ),
        _health(evaluations, run),
    ]
    return [Tiles(tiles), Paragraph(_sentence(evaluations, error_db))]


def _vibration(evaluations: Sequence[Evaluation]) -> Tile:
    begun = [each.start_s for each in evaluations if each.start_s is not None]
    ended = [each.stop_s for each in evaluations if each.stop_s is not None]
    if not begun:
        return Tile("vibration", "streamed throughout", "the model was never ready")
    among = "" if len(evaluations) == 1 else f", {len(begun)} of {len(evaluations)}"
    note = f"complete at {median(ended):.1f} s" if ended else "never complete"
    return Tile("vibration", f"from the model since {median(begun):.1f} s{among}", note)


def _readiness(evaluations: Sequence[Evaluation]) -> Tile:
    value = median(each.final.completion for each in evaluations)
    if all(each.settings.scale.rises for each in evaluations):
        return Tile("readiness", share(value), "of the strokes are expected to feel right")
    return Tile("readiness", number(value, 1), "sum of distances to samples; smaller is readier")


def _health(evaluations: Sequence[Evaluation], run: Mapping[str, Any]) -> Tile:
    leader = run.get("leader", {})
    outcome = leader.get("outcome", "completed")
    late = leader.get("ticks", {}).get("late_share_1ms") or 0.0
    missing = sum(each.missing_frames for each in evaluations)
    faults = [fault for each in evaluations if (fault := each.faults.sentence())]
    faults += [f"{share(late)} of the ticks late"] * (late > _LATE_SHARE)
    faults += ["cut off and mended"] * any(not each.complete for each in evaluations)
    note = f"{missing} frame{'s' * (missing != 1)} missing" if evaluations else ""
    if outcome not in ("completed", "interrupted"):
        return Tile("health", outcome, note, "failed")
    if faults:
        return Tile("health", "; ".join(faults), note, "degraded")
    return Tile("health", "all well", note)


def _sentence(evaluations: Sequence[Evaluation], error_db: float | None) -> str:
    against = "known texture" if evaluations[0].basis == "truth" else "held-out segments"
    right = _middle(each.final.within_jnd for each in evaluations)
    if right is None or error_db is None:
        return f"There is no model to compare with the {against}."
    relation = "less" if error_db < JND_DB else "more"
    whom = "the strokes that were made" if against == "known texture" else "their strokes"
    return (
        f"Against the {against} the level is right, within one just noticeable difference, on "
        f"{share(right)} of {whom}; it is off by {error_db:.1f} dB, {relation} than is noticed."
    )


def _middle(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known else None
