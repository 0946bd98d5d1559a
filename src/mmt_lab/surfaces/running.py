"""Run the tracker over sessions on several known surfaces, and score the changes that it found."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from mmt.cli.reporting import scene_of
from mmt.core.arrays import BoolArray, IntArray, RecordArray
from mmt.core.errors import InputError, naming
from mmt.scene import Scene, Texture
from mmt.session.files import read_session
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import SurfaceCourse, course_from_annotations
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.online.updates import SurfaceChange
from mmt.texture.settings import Inputs, ModellingSettings, SurfaceSettings, surface_check_frames
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.surfaces.tracking import SurfaceTracker
from mmt_lab.harness.experiment import hand_of
from mmt_lab.harness.processes import map_in_processes

LEAST_STROKED_S: Final = 0.3
"""A change that is not found in a stay with less stroking does not count as missed."""

LOOK_FRAMES: Final = surface_check_frames(1000.0)
"""Frames that the tracker gets at a time, as in the leader."""

COUNTS: Final = (2, 3, 4, 5, 6)
DURATION_S: Final = 90.0
STAY_S: Final = 8.0
RECORDED: Final = "recorded"
"""The group of sessions that were not simulated here."""

GROUPS: Final[Mapping[str, Inputs]] = {"isotropic": "isotropic", "grained": "anisotropic"}
"""Model inputs of the simulated sessions, by the kind of their textures."""

_TOUCH_N: Final = 0.05
_LEAST_SPEED_MM_S: Final = 10.0


@dataclass(frozen=True)
class FoundChange:
    """A change that was found, and the number of frames received by then."""

    change: SurfaceChange
    frame: int


@dataclass(frozen=True)
class SurfaceScore:
    """Figures of one session.

    ``delays_s``: for each stay but the first, time from first contact to the alarm, None if the
    change was missed; without stays of less than `LEAST_STROKED_S` of stroking and no alarm.
    ``false_alarms``: changes found in a stay whose own model was already in use.
    """

    stroked_s: float
    delays_s: tuple[float | None, ...]
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
    false = place = 0
    delays_s: list[float | None] = []
    for number, (start, stop) in enumerate(pairwise(edges)):
        alarm: FoundChange | None = None
        while place < len(found):
            own = alarm is not None or not number
            if _is_of_later(found[place].change, edges, number, own=own):
                break
            false += own
            alarm = alarm or found[place]
            place += 1
        stroked = float(stroking[start:stop].sum()) >= 1000.0 * LEAST_STROKED_S
        if number and (stroked or alarm is not None):
            touched = start + int(np.argmax(contact[start:stop]))
            delays_s.append(None if alarm is None else (alarm.frame - touched) / 1000.0)
    return SurfaceScore(float(stroking.sum()) / 1000.0, tuple(delays_s), false)


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


@dataclass(frozen=True)
class SurfaceResult:
    """One session: its surfaces, and the score of the tracker on it."""

    name: str
    surfaces: tuple[str, ...]
    score: SurfaceScore
    group: str = RECORDED


def run_simulated(
    seeds: int,
    *,
    first: int = 0,
    textures: Sequence[str] = tuple(SURFACES),
    hand: str = "strokes",
    stay_s: float = STAY_S,
    workers: int | None = None,
) -> list[SurfaceResult]:
    """Simulate and score sessions over 2 to 6 surfaces in random order.

    Two groups of sessions: over textures that are the same in all directions, and, with a hand
    that strokes along all headings, over some that depend on the heading. Half of the changes
    fall on a lift-off, half happen within contact. On a single texture there are no changes.
    """
    calls = [
        (group, chosen, seed, hand, stay_s)
        for group in GROUPS
        for seed in range(first, first + seeds)
        for count in (COUNTS if len(textures) > 1 else (1,))
        if (chosen := draw_surfaces(group, count, seed, textures))
    ]
    return map_in_processes(
        _simulated, calls, workers=workers, what="sessions over several surfaces"
    )


def run_recorded(path: Path) -> SurfaceResult:
    """Score a recorded session with a known course."""
    session = read_session(path)
    scene = scene_of(session, None)
    modelling = (scene.texture or Texture()).settings(session.samples_per_frame)
    with naming(path):
        course = course_from_annotations(session.annotations)
        return run_session(path.stem, course, session.frames, modelling)


def draw_surfaces(
    group: str, count: int, seed: int, textures: Sequence[str] = tuple(SURFACES)
) -> list[str]:
    """Draw `count` of the textures, or none if there are too few of the kinds that a group needs.

    In a grained session half of the textures, and at least two, have a grain, if there are enough.
    """
    random_order = random.Random(f"{count} {seed}")  # noqa: S311 - no secret
    plain, grained = (
        [name for name in textures if get_surface(name).isotropic == wanted]
        for wanted in (True, False)
    )
    with_grain = 0
    if group == "grained":
        with_grain = min(len(grained), count, max(2, (count + 1) // 2))
        if not with_grain:
            return []
    if count - with_grain > len(plain):
        return []
    chosen = random_order.sample(grained, with_grain)
    chosen += random_order.sample(plain, count - with_grain)
    if with_grain:
        random_order.shuffle(chosen)
    return chosen


def _simulated(
    group: str, textures: Sequence[str], seed: int, hand: str, stay_s: float
) -> SurfaceResult:
    number = 100 * len(textures) + seed
    duration_s = DURATION_S * stay_s / STAY_S
    course = SurfaceCourse.draw(
        [get_surface(name) for name in textures],
        stay_s=stay_s,
        when="either",
        duration_s=duration_s,
        seed=number,
    )
    scene = Scene(hand=hand_of(hand, isotropic=group == "isotropic"))
    frames, _ = simulate_session(scene, course, duration_s, number)
    name = f"{group}, {len(textures)} surfaces, seed {seed}"
    result = run_session(name, course, frames, ModellingSettings(inputs=GROUPS[group]))
    return replace(result, group=group)


def run_session(
    name: str,
    course: SurfaceCourse,
    frames: RecordArray,
    modelling: ModellingSettings | None = None,
) -> SurfaceResult:
    """Follow one session's frames, with all channels, and score the changes found."""
    if not len(frames) or int(frames["sequence"][-1]) != len(frames) - 1:
        raise InputError(f"{name}: a session over several surfaces is scored from whole frames")
    truth = course.places_by_frame(frames["force_n"][:, 2].astype(np.float64))
    names = [surface.name for surface in course.surfaces]
    return follow(name, names, truth, frames, modelling)


def follow(
    name: str,
    surfaces: Sequence[str],
    truth: IntArray,
    frames: RecordArray,
    modelling: ModellingSettings | None = None,
) -> SurfaceResult:
    """Follow frames (n,) with all channels, and score the changes found.

    ``truth`` (n,) is the index in ``surfaces`` of the surface under the tool in each frame.
    """
    modelling = modelling or ModellingSettings()
    tracker = SurfaceTracker(modelling, SurfaceSettings())
    found = []
    for start in range(0, len(frames), LOOK_FRAMES):
        part = frames[start : start + LOOK_FRAMES]
        found += [FoundChange(change, start + len(part)) for change in tracker.update(part)]
    force_n = frames["force_n"][:, 2].astype(np.float64)
    stroking = np.zeros(len(frames), dtype=np.bool_)
    aligned = StreamFilter(modelling).process(frames)
    steady = (aligned.speed_mm_s >= _LEAST_SPEED_MM_S) & (aligned.normal_force_n >= _TOUCH_N)
    stroking[aligned.index[steady]] = True
    return SurfaceResult(name, tuple(surfaces), score(truth, stroking, force_n > _TOUCH_N, found))
