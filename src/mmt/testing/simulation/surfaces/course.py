"""A tool that goes from one known surface to another, at seeded moments.

A change falls due at a frame that is drawn beforehand. It happens as soon as the tool has then
been off the surface for 30 ms, or, for a change within contact, on it for 30 ms. So the moments
follow from the schedule, which is stored with the recording, and from the recorded force.
"""

import json
from collections.abc import Sequence
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError
from mmt.scene import Simulated
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.surfaces.known_surfaces import (
    COURSE_VERSION,
    KnownSurface,
    Stroke,
    VibrationSource,
    encode_truth,
)
from mmt.testing.simulation.surfaces.textures import get_surface, surface_from_annotations

When = Literal["lifted", "contact", "either"]

SETTLED_TICKS: Final = 30
"""Ticks that the tool must stay off the surface, or on it, before it counts as that."""

_TOUCH_N: Final = 0.05
_LARGEST_COURSE: Final = 2000


class CourseChange(NamedTuple):
    """A change to a surface, given by its place in the course, due from this frame on."""

    due_frame: int
    surface: int
    in_contact: bool


class ContactWatch:
    """Finds the ticks at which changes happen, from the force."""

    def __init__(self, changes: Sequence[CourseChange]) -> None:
        self._changes = changes
        self._done = 0
        self._ticks = 0
        self._settled = 0
        self._touching = False
        self.surface = 0
        """Place in the course of the surface under the tool."""

    def step(self, force_n: float) -> int:
        """Take the next tick's normal force; return the place of the surface under the tool."""
        touching = force_n > _TOUCH_N
        self._settled = self._settled + 1 if touching == self._touching else 1
        self._touching = touching
        if self._done < len(self._changes):
            change = self._changes[self._done]
            settled = self._settled >= SETTLED_TICKS and touching == change.in_contact
            if settled and self._ticks >= change.due_frame:
                self.surface = change.surface
                self._done += 1
        self._ticks += 1
        return self.surface


class SurfaceCourse:
    """Several known surfaces and the changes between them.

    Parameters
    ----------
    surfaces
        Known surfaces; the tool begins on the first.
    changes
        Changes in the order of their frames; none leads to the surface under the tool.

    Raises
    ------
    InputError
        There is no surface, or the surfaces have different rates.
    """

    def __init__(self, surfaces: Sequence[KnownSurface], changes: Sequence[CourseChange]) -> None:
        if not surfaces:
            raise InputError("a course needs a surface")
        if len({surface.rate_hz for surface in surfaces}) > 1:
            raise InputError("the surfaces of a course must be of one rate")
        self.surfaces = tuple(surfaces)
        self.changes = tuple(changes)

    @classmethod
    def draw(
        cls,
        surfaces: Sequence[KnownSurface],
        *,
        stay_s: float,
        when: When,
        duration_s: float,
        seed: int,
    ) -> "SurfaceCourse":
        """Draw a course: each stay is uniform over half to one and a half times `stay_s`."""
        random = np.random.default_rng([seed, 3])
        changes: list[CourseChange] = []
        at_s, here = 0.0, 0
        while len(surfaces) > 1 and len(changes) < _LARGEST_COURSE:
            at_s += stay_s * float(random.uniform(0.5, 1.5))
            if at_s >= duration_s:
                break
            here = int(random.choice([n for n in range(len(surfaces)) if n != here]))
            in_contact = bool(random.random() < 0.5) if when == "either" else when == "contact"
            changes.append(CourseChange(round(at_s * RATE_HZ), here, in_contact))
        return cls(surfaces, changes)

    @property
    def friction_coefficient(self) -> float:
        """Friction coefficient of the first surface."""
        return self.surfaces[0].friction_coefficient

    @property
    def rate_hz(self) -> float:
        """See `KnownSurface`."""
        return self.surfaces[0].rate_hz

    @property
    def name(self) -> str:
        """Name in reports."""
        return ", ".join(surface.name for surface in self.surfaces)

    def annotations(self) -> bytes:
        """Return the truth as JSON, from which `course_from_annotations` rebuilds it."""
        parameters = {
            "surfaces": [json.loads(surface.annotations()) for surface in self.surfaces],
            "changes": [list(change) for change in self.changes],
        }
        return encode_truth(self.name, COURSE_VERSION, parameters)

    def vibration(self, generator: np.random.Generator) -> "CourseVibration":
        """Return a generator of the vibration under the tool."""
        return CourseVibration(self, generator)

    def places_by_frame(self, force_n: FloatArray) -> IntArray:
        """Return the place of the surface under the tool in each frame, from the force (n,)."""
        watch = ContactWatch(self.changes)
        return np.array([watch.step(force) for force in force_n.tolist()], dtype=np.int64)


def surface_of(
    settings: Simulated, duration_s: float, seed: int, rate_hz: float = RATE_HZ
) -> KnownSurface | SurfaceCourse:
    """Return a scene's surface at a rate, or draw its course over several.

    Raises
    ------
    InputError
        A surface is not known, or is named twice.
    """
    if settings.course is None:
        return get_surface(settings.surface, rate_hz)
    names = [settings.surface, *settings.course.surfaces]
    if len(set(names)) < len(names):
        raise InputError(f"[simulated.course] names a surface twice: {', '.join(names)}")
    return SurfaceCourse.draw(
        [get_surface(name, rate_hz) for name in names],
        stay_s=settings.course.stay_s,
        when=settings.course.change,
        duration_s=duration_s,
        seed=seed,
    )


class CourseVibration(VibrationSource):
    """The vibration of the surface under the tool; each call of `run` makes a frame."""

    def __init__(self, course: SurfaceCourse, generator: np.random.Generator) -> None:
        self._watch = ContactWatch(course.changes)
        self._course = course
        parts = generator.spawn(len(course.surfaces))
        self._each = [
            surface.vibration(part) for surface, part in zip(course.surfaces, parts, strict=True)
        ]

    @property
    def friction_coefficient(self) -> float:
        """Friction of the surface under the tool."""
        return self._course.surfaces[self._watch.surface].friction_coefficient

    def run(self, count: int, stroke: Stroke) -> list[tuple[float, float]]:
        """Return the next samples; see `VibrationSource.run`."""
        return self._each[self._watch.step(stroke.force_n)].run(count, stroke)


def course_from_annotations(annotations: bytes) -> SurfaceCourse:
    """Rebuild the course that a recording's annotations describe.

    Raises
    ------
    InputError
        The bytes hold no course of a known version.
    """
    try:
        truth = json.loads(annotations)
        if truth["version"] != COURSE_VERSION:
            raise InputError("the recording's truth is a single surface, not a course over several")
        parameters = truth["parameters"]
        return SurfaceCourse(
            [surface_from_annotations(json.dumps(one).encode()) for one in parameters["surfaces"]],
            [_change(change, len(parameters["surfaces"])) for change in parameters["changes"]],
        )
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"annotations hold no course over surfaces: {error!r}") from error


def _change(values: Sequence[Any], surfaces: int) -> CourseChange:
    due_frame, surface, in_contact = values
    change = CourseChange(int(due_frame), int(surface), bool(in_contact))
    if not 0 <= change.surface < surfaces:
        raise InputError(f"annotations name surface {change.surface} of {surfaces}")
    return change
