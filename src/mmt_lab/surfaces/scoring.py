"""Score of the changes that a tracker found, against the true course of the tool."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, IntArray
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.online.surface_changes import SurfaceChange

LEAST_STROKED_S: Final = 0.3
"""A change that is not found in a stay with less stroking does not count as missed."""


@dataclass(frozen=True)
class FoundChange:
    """A change that was found, and the number of frames received by then."""

    change: SurfaceChange
    frame: int


@dataclass(frozen=True)
class Stay:
    """One stay on a surface, except for the first stay of a session.

    ``surface``: its index in the course. ``in_contact``: the change happened within contact.
    ``delay_s``: time from first contact to the alarm, None if the change was missed.
    """

    surface: int
    in_contact: bool
    delay_s: float | None


@dataclass(frozen=True)
class SurfaceScore:
    """Figures of one session.

    ``too_short``: stays with less than `LEAST_STROKED_S` of stroking and no alarm.
    ``false_alarms``: changes found in a stay whose own model was already in use.
    """

    surfaces: int
    stroked_s: float
    stays: tuple[Stay, ...]
    too_short: int
    false_alarms: int


def score(
    truth: IntArray, stroking: BoolArray, contact: BoolArray, found: Sequence[FoundChange]
) -> SurfaceScore:
    """Compare the changes found with the truth.

    A change belongs to the stay from which most of its samples come, even if it is found when the
    tool has just left that surface: it describes the vibration of that stay. But if that stay has
    its own model already, and a whole block of the next stay was received, the change belongs to
    the next stay, and was dated too early.

    Parameters
    ----------
    truth, stroking, contact
        For each frame (n,): the surface, whether the tool strokes it, and touches it.
    found
        Changes found, in the order of their frames.
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
