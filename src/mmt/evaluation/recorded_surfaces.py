"""A recorded session split by surface as in the live leader, with the statements of persons."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mmt.core.arrays import IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.session.data import RecordedSession, missing_frames
from mmt.testing.simulation.surfaces.course import SurfaceCourse, course_from_annotations
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
    tool really went over, ``truth``: which of them in each frame (n,); both None if unknown.
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
    statements = surface_statements(session.events)
    edges = _stays(list(surface_changes(frames, settings, statements)), frames)
    course = _course(session)
    truth = _truth(course, frames)
    sequence = frames["sequence"].astype(np.int64)
    first = int(sequence[0])
    stays, blocks = [], dict[int, list[RecordArray]]()
    of_surface = dict[int, list[IntArray]]()
    for surface, start, stop, found in edges:
        inside = (sequence >= start) & (sequence < stop)
        under = np.empty(0, np.int64) if truth is None else truth[inside]
        if inside.any():
            blocks.setdefault(surface, []).append(frames[inside])
            of_surface.setdefault(surface, []).append(under)
        stays.append(
            SurfaceStay(
                surface=surface,
                from_s=(start - first) / settings.rate_hz,
                to_s=(stop - first) / settings.rate_hz,
                found_s=None if found is None else (found - first) / settings.rate_hz,
                truth=_name(course, under),
            )
        )
    return SurfaceParts(
        stays=tuple(stays),
        sessions={
            number: replace(
                session,
                frames=np.concatenate(trials(parts)),
                annotations=_annotations(session, course, np.concatenate(of_surface[number])),
                models=(),
                events=(),
                outputs=(),
            )
            for number, parts in sorted(blocks.items())
        },
        missing={n: sum(missing_frames(part) for part in parts) for n, parts in blocks.items()},
        course=course,
        truth=truth,
    )


def _stays(
    changes: Sequence[SurfaceChange], frames: RecordArray
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
    """Return which of the course's surfaces was under the tool in each frame, (n,).

    The course counts every frame: one that is missing counts as the one before it.
    """
    if course is None:
        return None
    sequence = frames["sequence"].astype(np.int64)
    last_known = np.searchsorted(sequence, np.arange(int(sequence.max()) + 1), side="right") - 1
    force_n = frames["force_n"][:, 2].astype(np.float64)[np.maximum(last_known, 0)]
    return course.places_by_frame(force_n)[sequence]


def _name(course: SurfaceCourse | None, under: IntArray) -> str | None:
    if course is None or not len(under):
        return None
    return course.surfaces[int(np.bincount(under).argmax())].name


def _annotations(session: RecordedSession, course: SurfaceCourse | None, under: IntArray) -> bytes:
    """Return the truth of the surface that was under the tool for most of the frames."""
    if course is None:
        return session.annotations
    return course.surfaces[int(np.bincount(under).argmax())].annotations()
