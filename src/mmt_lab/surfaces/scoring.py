"""What a tracker found, beside the course that the tool really took."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, IntArray
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.surfaces import SurfaceChange

LEAST_STROKED_S: Final = 0.3
"""A stay with less stroking says nothing: what is not found there is not counted as missed."""


@dataclass(frozen=True)
class Found:
    """A change that was found, and the newest frame by then."""

    change: SurfaceChange
    frame: int


@dataclass(frozen=True)
class Stay:
    """One stay on a surface but for the session's first.

    ``surface``: its place in the course. ``known``: whether the tool had been there before
    and the tracker has a model of it. ``in_contact``: the change happened within contact.
    ``delay_s``: from first contact to the alarm, None where there was none. ``stroked_delay_s``
    the same in stroking. ``recall_s``: from first contact until the right model was recalled
    for good. ``outcome``: ``"right"``, ``"wrong"`` (the model of another surface), ``"doubled"``
    (a second model of a known one), ``"missed"``; as it was at the end of the stay.
    """

    surface: int
    known: bool
    in_contact: bool
    delay_s: float | None
    stroked_delay_s: float | None
    recall_s: float | None
    outcome: str


@dataclass(frozen=True)
class SurfaceScore:
    """Figures of one session.

    ``too_short``: stays with less than `LEAST_STROKED_S` of stroking. ``recalls``: how often a
    known model was chosen, ``wrong_recalls``: how often that of another surface.
    ``models_too_many``: models made beside the first one of each surface, and ``models_left``
    those of them that were neither merged nor forgotten by the end.
    """

    surfaces: int
    stroked_s: float
    stays: tuple[Stay, ...]
    too_short: int
    recalls: int
    wrong_recalls: int
    false_alarms: int
    models_too_many: int
    models_left: int


def score(
    truth: IntArray,
    stroking: BoolArray,
    contact: BoolArray,
    found: Sequence[Found],
    kept: Collection[int],
) -> SurfaceScore:
    """Compare what was found with the truth.

    A change belongs to the stay from which most of its samples come, even if it is found when the
    tool has just left that surface: it describes the vibration of that stay. Where the tracker
    was right about that stay, and a whole block of the next one was received, it was the next one
    that was found, though dated too early. A new surface is that one's from then on.

    Parameters
    ----------
    truth, stroking, contact
        For each frame (n,): the surface, whether the tool strokes it, and touches it.
    found
        In the order of their frames.
    kept
        Numbers of the models that there are at the end.
    """
    belief = _Belief(int(truth[0]))
    edges = [0, *(np.flatnonzero(np.diff(truth)) + 1).tolist(), len(truth)]
    recalls = wrong = false = place = 0
    stays: list[Stay] = []
    too_short = 0
    for number, (start, stop) in enumerate(pairwise(edges)):
        surface = int(truth[start])
        known = surface in belief.labels.values() if number else False
        alarm: Found | None = None
        settled: Found | None = None
        while place < len(found):
            item, was_right = found[place], belief.is_of(surface)
            if _is_of_later(item.change, edges, number, was_right=was_right):
                break
            place += 1
            belief.follow(item.change, surface)
            if item.change.kind != "new":
                recalls += 1
                wrong += not belief.is_of(surface)
            if item.change.kind != "identified":
                false += was_right
                alarm = alarm or item
            settled = item if belief.is_of(surface) else None
        if not number:
            continue
        touched = start + int(np.argmax(contact[start:stop]))
        if float(stroking[start:stop].sum()) < 1000.0 * LEAST_STROKED_S and alarm is None:
            too_short += 1
            continue
        stays.append(
            Stay(
                surface=surface,
                known=known,
                in_contact=touched == start,
                delay_s=_seconds(alarm, touched),
                stroked_delay_s=_stroked(alarm, touched, stroking),
                recall_s=_seconds(settled, touched) if known else None,
                outcome=belief.outcome(surface, known=known, alarm=alarm),
            )
        )
    return SurfaceScore(
        surfaces=len(set(truth.tolist())),
        stroked_s=float(stroking.sum()) / 1000.0,
        stays=tuple(stays),
        too_short=too_short,
        recalls=recalls,
        wrong_recalls=wrong,
        false_alarms=false,
        models_too_many=len(belief.labels) - len(set(belief.labels.values())),
        models_left=len(kept) - len({belief.labels[number] for number in kept}),
    )


class _Belief:
    """Which surface the tracker takes the tool to be on: that of its current model.

    ``labels``: the surface that each model is of, by its number.
    """

    def __init__(self, first: int) -> None:
        self.labels = {1: first}
        self._current = 1

    def is_of(self, surface: int) -> bool:
        """Say whether the current model is that surface's."""
        return self.labels.get(self._current) == surface

    def follow(self, change: SurfaceChange, surface: int) -> None:
        """Take a change that was found on a surface."""
        self._current = change.surface
        if change.kind == "new":
            self.labels[change.surface] = surface

    def outcome(self, surface: int, *, known: bool, alarm: Found | None) -> str:
        """Return the outcome of a stay on a surface, as it ends."""
        if not self.is_of(surface):
            return "missed" if alarm is None else "wrong"
        if not known:
            return "right"
        first = min(number for number, label in self.labels.items() if label == surface)
        return "right" if self._current == first else "doubled"


def _is_of_later(
    change: SurfaceChange, edges: Sequence[int], number: int, *, was_right: bool
) -> bool:
    """Say whether a change belongs to a later stay than this one; see `score`."""
    shares = [
        min(change.at_sample, stop) - max(change.since_sample, start)
        for start, stop in pairwise(edges)
    ]
    if int(np.argmax(shares)) > number:
        return True
    next_one = shares[number + 1] if number + 1 < len(shares) else 0
    return was_right and change.kind != "identified" and next_one >= 1000.0 * BLOCK_S


def _seconds(item: Found | None, touched: int) -> float | None:
    return None if item is None else (item.frame - touched) / 1000.0


def _stroked(item: Found | None, touched: int, stroking: BoolArray) -> float | None:
    return None if item is None else float(stroking[touched : item.frame].sum()) / 1000.0
