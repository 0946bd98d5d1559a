"""Run the tracker over sessions on several known surfaces."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.arrays import RecordArray
from mmt.devices.simulated.course import SurfaceCourse
from mmt.devices.simulated.offline import simulate_session
from mmt.devices.simulated.textures import SURFACES
from mmt.errors import InputError
from mmt.evaluation.surfaces.scoring import Found, SurfaceScore, score
from mmt.scene import Scene
from mmt.texture.filtering import StreamFilter
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.surfaces.modelling import LOOK_S
from mmt.texture.surfaces.tracking import SurfaceTracker

LOOK_FRAMES: Final = round(1000 * LOOK_S)
"""The tracker gets so many frames at a time, as the leader's does."""

COUNTS: Final = (2, 3, 4, 5, 6)
DURATION_S: Final = 90.0
STAY_S: Final = 8.0
_TOUCH_N: Final = 0.05
_LEAST_SPEED_MM_S: Final = 10.0


@dataclass(frozen=True)
class SurfaceResult:
    """One session: what it went over, and how it was followed."""

    name: str
    surfaces: tuple[str, ...]
    score: SurfaceScore


def run_simulated(
    seeds: int, progress: Callable[[int, int], None] = lambda _done, _all: None
) -> list[SurfaceResult]:
    """Simulate and score sessions over 2 to 6 surfaces in random order, of so many seeds each.

    A third of the surfaces' names is drawn anew for each session, from all known textures that
    are the same in all directions. Half of the changes fall on a lift-off, half happen within
    contact.
    """
    names = [name for name, surface in SURFACES.items() if surface.isotropic]
    results = []
    for done, (count, seed) in enumerate((c, s) for s in range(seeds) for c in COUNTS):
        progress(done, seeds * len(COUNTS))
        chosen = random.Random(f"{count} {seed}").sample(names, count)  # noqa: S311 - no secret
        number = 100 * count + seed
        course = SurfaceCourse.draw(
            [SURFACES[name] for name in chosen],
            stay_s=STAY_S,
            when="either",
            duration_s=DURATION_S,
            seed=number,
        )
        frames, _ = simulate_session(Scene(), course, DURATION_S, number)
        results.append(run_session(f"{count} surfaces, seed {seed}", course, frames))
    return results


def run_session(
    name: str,
    course: SurfaceCourse,
    frames: RecordArray,
    modelling: ModellingSettings | None = None,
    settings: SurfaceSettings | None = None,
) -> SurfaceResult:
    """Follow one session's frames, with all channels, and score what was found.

    Raises
    ------
    InputError
        There are no frames, or frames are missing: the course counts every one.
    """
    if not len(frames) or int(frames["sequence"][-1]) != len(frames) - 1:
        raise InputError(f"{name}: a session over several surfaces is scored from whole frames")
    modelling = modelling or ModellingSettings()
    tracker = SurfaceTracker(modelling, settings or SurfaceSettings())
    found = []
    for start in range(0, len(frames), LOOK_FRAMES):
        part = frames[start : start + LOOK_FRAMES]
        found += [Found(change, start + len(part)) for change in tracker.take(part)]
    force_n = frames["force_n"][:, 2].astype(np.float64)
    stroking = np.zeros(len(frames), dtype=np.bool_)
    aligned = StreamFilter(modelling.normal, modelling.axis, modelling.rate_hz).process(frames)
    steady = (aligned.speed_mm_s >= _LEAST_SPEED_MM_S) & (aligned.normal_force_n >= _TOUCH_N)
    stroking[aligned.index[steady]] = True
    return SurfaceResult(
        name=name,
        surfaces=tuple(surface.name for surface in course.surfaces),
        score=score(course.along(force_n), stroking, force_n > _TOUCH_N, found),
    )
