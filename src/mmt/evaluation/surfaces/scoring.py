"""What a tracker found, beside the course that the tool really took."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.arrays import BoolArray, IntArray
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
    """Of one session.

    ``too_short``: stays with less than `LEAST_STROKED_S` of stroking. ``recalls``: how often a
    known model was chosen, ``wrong_recalls``: how often that of another surface.
    """

    surfaces: int
    stroked_s: float
    stays: tuple[Stay, ...]
    too_short: int
    recalls: int
    wrong_recalls: int
    false_alarms: int


class _Labels:
    """Which true surface each of the tracker's numbers stands for."""

    def __init__(self, truth: IntArray) -> None:
        self._truth = truth
        self.of: dict[int, int] = {1: int(truth[0])}

    def at(self, frame: int) -> int:
        """Return the true surface in a frame."""
        return int(self._truth[min(max(frame, 0), len(self._truth) - 1)])

    def learn(self, change: SurfaceChange) -> None:
        """Take a new surface's label from where it was found."""
        if change.kind == "new":
            self.of[change.surface] = self.at(change.at_sample - 1)


def score(
    truth: IntArray, stroking: BoolArray, contact: BoolArray, found: Sequence[Found]
) -> SurfaceScore:
    """Compare what was found with the truth.

    A change belongs to the stay in which the newest of the samples lies that it was found from,
    also where the tool has left that surface by the time filters and the leader's period have
    passed.

    Parameters
    ----------
    truth, stroking, contact
        For each frame (n,): the surface, whether the tool strokes it, and touches it.
    found
        In the order of their frames.
    """
    labels = _Labels(truth)
    edges = [0, *(np.flatnonzero(np.diff(truth)) + 1).tolist(), len(truth)]
    recalls = wrong = false = 0
    current, place = 1, 0
    stays: list[Stay] = []
    too_short = 0
    for number, (start, stop) in enumerate(pairwise(edges)):
        surface = int(truth[start])
        known = surface in labels.of.values() if number else False
        alarm: Found | None = None
        settled: Found | None = None
        while place < len(found) and found[place].change.at_sample <= stop:
            item = found[place]
            place += 1
            was_right = labels.of.get(current) == surface
            labels.learn(item.change)
            if item.change.kind != "identified":
                false += was_right
                alarm = alarm or item
            if item.change.kind != "new":
                recalls += 1
                wrong += labels.of.get(item.change.surface) != surface
            current = item.change.surface
            settled = item if labels.of.get(current) == surface else None
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
                outcome=_outcome(labels, current, surface, known=known, alarm=alarm),
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
    )


def _seconds(item: Found | None, touched: int) -> float | None:
    return None if item is None else (item.frame - touched) / 1000.0


def _stroked(item: Found | None, touched: int, stroking: BoolArray) -> float | None:
    return None if item is None else float(stroking[touched : item.frame].sum()) / 1000.0


def _outcome(
    labels: _Labels, current: int, surface: int, *, known: bool, alarm: Found | None
) -> str:
    if labels.of.get(current) != surface:
        return "missed" if alarm is None else "wrong"
    if not known:
        return "right"
    first = min(number for number, label in labels.of.items() if label == surface)
    return "right" if current == first else "doubled"
