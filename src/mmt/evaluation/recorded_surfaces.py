"""A recorded session split by surface as in the live leader, with the statements of persons."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mmt.core.arrays import BoolArray, IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.session.data import RecordedSession, missing_frames
from mmt.testing.simulation.surfaces.course import SurfaceCourse, course_from_annotations
from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface
from mmt.texture.online.history import trials
from mmt.texture.online.updates import SurfaceChange, surface_statements
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.filtering import StreamNumbering
from mmt.texture.surfaces.tracking import surface_changes


@dataclass(frozen=True)
class SurfaceStay:
    """One stay on a surface, as the leader found it.

    ``surface``: its number. ``from_s`` and ``to_s``: session times. ``found_s``: when the leader
    found it, None for the session's first. ``truth``: the name of the known surface that was under
    the tool for most of it, None if that is not recorded.
    """

    surface: int
    from_s: float
    to_s: float
    found_s: float | None
    truth: str | None


@dataclass(frozen=True, eq=False)
class SurfaceParts:
    """A session by its surfaces.

    ``stays`` in order. ``sessions``: by number, the frames of all stays on a surface as one
    session, without the time in between; with the surface's truth if it is known.
    ``missing``: by number, frames that are missing within its stays. ``course``: surfaces that the
    tool really went over, ``truth``: which of them in each tick from the first frame to the last,
    (m,); both None if unknown.
    """

    stays: tuple[SurfaceStay, ...]
    sessions: dict[int, RecordedSession]
    missing: dict[int, int]
    course: SurfaceCourse | None
    truth: IntArray | None


def part_by_surface(session: RecordedSession, settings: ModellingSettings) -> SurfaceParts:
    """Split a session by its surfaces.

    Parameters
    ----------
    session
        With position, force and acceleration, and at least one frame.
    settings
        Settings of the modelling; ``surfaces`` sets how surfaces are told apart.
    """
    frames = StreamNumbering().number(session.frames)
    changes = surface_changes(frames, settings, surface_statements(session.events))
    course = _course(session)
    truth = _truth(course, frames)
    sequence = frames["sequence"].astype(np.int64)
    under = None if truth is None else truth[sequence - sequence[0]]
    stays, masks = [], dict[int, list[BoolArray]]()

    def at_s(sample: int) -> float:
        return (sample - int(sequence[0])) / settings.rate_hz

    for surface, start, stop, found in _stays(changes, frames):
        inside: BoolArray = (sequence >= start) & (sequence < stop)
        if inside.any():
            masks.setdefault(surface, []).append(inside)
        known = _surface_under(course, under, inside)
        stays.append(
            SurfaceStay(
                surface=surface,
                from_s=at_s(start),
                to_s=at_s(stop),
                found_s=None if found is None else at_s(found),
                truth=None if known is None else known.name,
            )
        )
    alone = replace(session, models=(), events=(), outputs=())
    parts = {n: [frames[inside] for inside in each] for n, each in sorted(masks.items())}
    sessions = {}
    for number, own in parts.items():
        known = _surface_under(course, under, np.any(masks[number], axis=0))
        told = session.annotations if known is None else known.annotations()
        frames_there = np.concatenate(trials(own))
        sessions[number] = replace(alone, frames=frames_there, annotations=told)
    missing = {number: sum(map(missing_frames, own)) for number, own in parts.items()}
    return SurfaceParts(tuple(stays), sessions, missing, course, truth)


def _stays(
    changes: Iterable[SurfaceChange], frames: RecordArray
) -> list[tuple[int, int, int, int | None]]:
    """Return surface, first and last sample (exclusive) of each stay, and where it was found."""
    begun: list[tuple[int, int, int | None]] = [(1, int(frames["sequence"][0]), None)]
    for change in changes:
        if change.kind == "identified":
            _, start, found = begun[-1]
            begun[-1] = (change.surface, start, found)
        else:
            begun.append((change.surface, change.from_sample, change.at_sample))
    edges = [start for _, start, _ in begun] + [int(frames["sequence"].max()) + 1]
    return [
        (surface, start, stop, found)
        for (surface, _, found), (start, stop) in zip(begun, pairwise(edges), strict=True)
    ]


def _course(session: RecordedSession) -> SurfaceCourse | None:
    if not session.annotations:
        return None
    try:
        return course_from_annotations(session.annotations)
    except InputError:  # none, or a single surface
        return None


def _truth(course: SurfaceCourse | None, frames: RecordArray) -> IntArray | None:
    """Return which of the course's surfaces was under the tool, from the first frame on, (m,).

    The course counts every tick: a frame that is missing counts as the one before it.
    """
    if course is None:
        return None
    sequence = frames["sequence"].astype(np.int64)
    last_known = np.searchsorted(sequence, np.arange(int(sequence.max()) + 1), side="right") - 1
    force_n = frames["force_n"][:, 2].astype(np.float64)[np.maximum(last_known, 0)]
    return course.places_by_frame(force_n)[sequence[0] :]


def _surface_under(
    course: SurfaceCourse | None, under: IntArray | None, inside: BoolArray
) -> KnownSurface | None:
    """Return the surface that was under the tool for most of some frames, None if unknown."""
    if course is None or under is None or not inside.any():
        return None
    return course.surfaces[int(np.bincount(under[inside]).argmax())]
