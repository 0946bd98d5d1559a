"""What a tracker found, beside the course that the tool really took."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, IntArray
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.online.surface_changes import SurfaceChange

LEAST_STROKED_S: Final = 0.3
"""A stay with less stroking says nothing: what is not found there is not counted as missed."""


@dataclass(frozen=True)
class FoundChange:
    """A change that was found, and the newest frame by then."""

    change: SurfaceChange
    frame: int


@dataclass(frozen=True)
class Stay:
    """One stay on a surface but for the session's first.

    ``surface``: its place in the course. ``in_contact``: the change happened within contact.
    ``delay_s``: from first contact to the alarm, None where there was none: it was missed.
    """

    surface: int
    in_contact: bool
    delay_s: float | None


@dataclass(frozen=True)
class SurfaceScore:
    """Figures of one session.

    ``too_short``: stays with less than `LEAST_STROKED_S` of stroking. ``false_alarms``: changes
    that were found while the model in use was begun in the stay.
    """

    surfaces: int
    stroked_s: float
    stays: tuple[Stay, ...]
    too_short: int
    false_alarms: int


def score(
    truth: IntArray, stroking: BoolArray, contact: BoolArray, found: Sequence[FoundChange]
) -> SurfaceScore:
    """Compare what was found with the truth.

    A change belongs to the stay from which most of its samples come, even if it is found when the
    tool has just left that surface: it describes the vibration of that stay. Where that stay has a
    model of its own already, and a whole block of the next one was received, it was the next one
    that was found, though dated too early.

    Parameters
    ----------
    truth, stroking, contact
        For each frame (n,): the surface, whether the tool strokes it, and touches it.
    found
        In the order of their frames.
    """
    edges = [0, *(np.flatnonzero(np.diff(truth)) + 1).tolist(), len(truth)]
    false = place = too_short = 0
    stays: list[Stay] = []
    for number, (start, stop) in enumerate(pairwise(edges)):
        alarm: FoundChange | None = None
        while place < len(found):
            own = alarm is not None or not number
            if _is_of_later(found[place].change, edges, number, own=own):
                break
            false += own
            alarm = alarm or found[place]
            place += 1
        if not number:
            continue
        touched = start + int(np.argmax(contact[start:stop]))
        if float(stroking[start:stop].sum()) < 1000.0 * LEAST_STROKED_S and alarm is None:
            too_short += 1
            continue
        stays.append(
            Stay(
                surface=int(truth[start]),
                in_contact=touched == start,
                delay_s=None if alarm is None else (alarm.frame - touched) / 1000.0,
            )
        )
    return SurfaceScore(
        surfaces=len(set(truth.tolist())),
        stroked_s=float(stroking.sum()) / 1000.0,
        stays=tuple(stays),
        too_short=too_short,
        false_alarms=false,
    )


def _is_of_later(change: SurfaceChange, edges: Sequence[int], number: int, *, own: bool) -> bool:
    """Say whether a change belongs to a later stay than this one; see `score`."""
    shares = [
        min(change.at_sample, stop) - max(change.from_sample, start)
        for start, stop in pairwise(edges)
    ]
    if int(np.argmax(shares)) > number:
        return True
    next_one = shares[number + 1] if number + 1 < len(shares) else 0
    return own and next_one >= 1000.0 * BLOCK_S
