"""Changes of surface in a recorded session, found faster than real time."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal, NamedTuple

from mmt.core.arrays import RecordArray
from mmt.core.frames import check_frames, samples_per_frame
from mmt.texture.online.surface_changes import SaidSurface, SurfaceChange
from mmt.texture.settings import ModellingSettings, SurfaceSettings, surface_check_frames
from mmt.texture.signals.numbering import StreamNumbering
from mmt.texture.surfaces.tracking import SurfaceTracker


class FoundSurface(NamedTuple):
    """A change of surface, as it was found while the session ran."""

    time_s: float
    """Session time at which the change was found."""
    surface: int
    """The number of the surface that the tool is on; a session begins on surface 1."""
    kind: Literal["new", "recalled", "identified"]
    """``"new"``: a surface not met before. Named by a person, ``"recalled"``: one met before;
    ``"identified"``: the surface found as new is one met before."""
    from_s: float
    """Session time of the change itself, before it was found."""


def follow_surfaces(
    frames: RecordArray,
    settings: ModellingSettings | None = None,
    said: Iterable[SaidSurface] = (),
) -> Iterator[FoundSurface]:
    """Yield each change of surface in a session, as the live leader finds it.

    A detected change begins a new surface; only a person can say that it is one met before.

    Parameters
    ----------
    frames
        Shape (n,), with position, force and acceleration.
    settings
        Settings of the modelling; ``surfaces`` sets how surfaces are told apart. None takes the
        defaults, for both. The number of samples per frame is taken from the frames.
    said
        Statements of persons, which `mmt.texture.online.surface_changes.said_surfaces` returns
        from the events of a recording.

    Examples
    --------
    >>> import mmt
    >>> wood, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=4.0)
    >>> list(mmt.follow_surfaces(wood))
    []
    """
    check_frames(frames)
    settings = settings or ModellingSettings()
    settings = replace(settings, samples_per_frame=samples_per_frame(frames.dtype))
    first = int(frames["sequence"][0]) if len(frames) else 0
    for change in surface_changes(frames, settings, said):
        yield FoundSurface(
            time_s=(change.at_sample - first) / settings.rate_hz,
            surface=change.surface,
            kind=change.kind,
            from_s=(change.from_sample - first) / settings.rate_hz,
        )


def surface_changes(
    frames: RecordArray, settings: ModellingSettings, said: Iterable[SaidSurface] = ()
) -> Iterator[SurfaceChange]:
    """Yield each change of surface in frames (n,) by sample numbers, see `follow_surfaces`."""
    tracker = SurfaceTracker(settings, settings.surfaces or SurfaceSettings())
    for word in said:
        tracker.say(word)
    look = surface_check_frames(settings.rate_hz)
    numbering = StreamNumbering()
    for start in range(0, len(frames), look):
        yield from tracker.update(numbering.number(frames[start : start + look]))
