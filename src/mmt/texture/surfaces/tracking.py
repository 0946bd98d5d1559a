"""Surface tracking from frames: detected changes of surface, and statements of persons.

For each change-point, a Bayes factor compares two explanations of the blocks from there on: an
unknown surface, and the current one. Both are regressions of `mmt.texture.surfaces.blocks`, one
without blocks, one of the current surface's blocks. Prediction errors are alike over a stroke, and
now and then a stroke differs from the prediction. So evidence is tempered: its logarithm is
multiplied by `TEMPER` (Grunwald, "The safe Bayesian", 2012). A change is detected if the result
exceeds the logarithm of the number of blocks in an hour over the false alarms allowed in an hour.
The blocks of the last second or two may already be another surface's, and are not learned yet.
"""

import math
from bisect import insort
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.frames import check_frames, samples_per_frame
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.online.updates import SurfaceChange, SurfaceStatement
from mmt.texture.settings import ModellingSettings, SurfaceSettings, surface_check_frames
from mmt.texture.signals.aligned import SignalFaults
from mmt.texture.signals.filtering import StreamFilter, StreamNumbering
from mmt.texture.space import InputSpace
from mmt.texture.surfaces.blocks import (
    SurfaceBlock,
    SurfaceBlockCutter,
    SurfaceRegression,
    features,
)

WINDOW: Final = 30
"""Number of newest blocks that may contain a change; the regression learns from older ones."""

TEMPER: Final = 0.25
"""Factor on the logarithm of a Bayes factor, since prediction errors are alike over a stroke.
Chosen on the development half of HaTT's models among 0.2, 0.25, 0.3, 0.4 and 0.5."""

_TOGETHER: Final = 10
"""Number of blocks that are learned at a time."""

_TESTED: Final = 2
"""Number of blocks between two tests."""

NAMED_S: Final = 4.0
"""Time after a detected change in which a person's statement is on the surface since then."""


class Detection(NamedTuple):
    """A detected change.

    ``from_sample``: the change-point; ``at_sample``: the sample at which it was detected;
    ``evidence``: natural logarithm of the Bayes factor.
    """

    from_sample: int
    at_sample: int
    evidence: float


class SurfaceDetector:
    """Detector of changes of surface, updated block by block.

    Cost: about 40 ms for a second of stroking.

    Parameters
    ----------
    false_alarms_per_hour
        False changes that are allowed in an hour of stroking; see `TEMPER`.
    by_heading
        Whether the texture may depend on the heading.
    """

    def __init__(self, false_alarms_per_hour: float = 1.0, *, by_heading: bool = False) -> None:
        self._directed = by_heading
        self.least_evidence = math.log(3600.0 / BLOCK_S / false_alarms_per_hour) / TEMPER
        self._unknown = SurfaceRegression(directed=by_heading)
        self.window: list[SurfaceBlock] = []
        self.begin(0)

    def begin(self, from_sample: int) -> None:
        """Begin another surface at a sample, and forget all blocks before it."""
        self.window = [block for block in self.window if block.start >= from_sample]
        self._current = SurfaceRegression(directed=self._directed)

    def update(self, block: SurfaceBlock) -> Detection | None:
        """Add the next block; return the change that it reveals, if any."""
        self.window.append(block)
        if len(self.window) % _TESTED == 0:
            found = self._test()
            if found is not None:
                return found
        if len(self.window) >= WINDOW + _TOGETHER:
            self._current.learn(*self._arrays(self.window[:_TOGETHER]))
            del self.window[:_TOGETHER]
        return None

    def _arrays(self, blocks: list[SurfaceBlock]) -> tuple[FloatArray, FloatArray]:
        """Return the features and values of blocks for a regression."""
        rows = features(np.array([block.stroke for block in blocks]), directed=self._directed)
        return rows, np.array([block.values for block in blocks])

    def _test(self) -> Detection | None:
        """Return the likeliest change in the window, if there is evidence enough for one."""
        rows, values = self._arrays(self.window)
        stayed = np.cumsum(self._current.log_densities(rows, values)[::-1])
        # By the chain rule, one backward pass gives the evidence of the last k blocks for all k.
        evidence = np.cumsum(self._unknown.log_densities(rows[::-1], values[::-1])) - stayed
        since = int(np.argmax(evidence))
        if evidence[since] <= self.least_evidence:
            return None
        first = len(self.window) - 1 - since
        block, at_sample = self.window[first], self.window[-1].stop
        if block.touchdown or first == 0:
            from_sample = min(block.start, max(block.contact_start, 0))
            self.begin(block.start)
        else:  # the block before may be of both surfaces
            from_sample = self.window[first - 1].start
            self.begin(block.stop)
        return Detection(from_sample, at_sample, float(evidence[since]))


class SurfaceTracker:
    """Tracker of the surface under the tool in a stream of frames.

    A detected change begins a new surface. A return to a known surface is not detected: a person
    says it (`state_surface`). Within `NAMED_S` of a detected change the statement is on the new
    surface, which then was the named one all along. Otherwise it holds from the named sample on.

    Cost: that of `SurfaceDetector`.

    Parameters
    ----------
    modelling
        Settings of the modelling: axes, least speed and force, inputs.
    settings
        Settings of the detection.
    """

    def __init__(self, modelling: ModellingSettings, settings: SurfaceSettings) -> None:
        self._filter = StreamFilter(modelling)
        self._cutter = SurfaceBlockCutter(modelling)
        self._detector = SurfaceDetector(
            settings.false_alarms_per_hour, by_heading=InputSpace(modelling.inputs).directed
        )
        self._most = settings.most
        self._named_samples = round(NAMED_S * modelling.rate_hz)
        self._statements: list[SurfaceStatement] = []
        self._found: SurfaceChange | None = None  # the detected change by which this stay began
        self.surface = 1
        """Number of the surface that the tool is taken to be on."""
        self.surfaces = [1]
        """Numbers of the surfaces that are kept; the one left longest ago is first."""
        self._largest = 1
        self.stroked_s = 0.0
        """Seconds of stroking analysed."""

    @property
    def faults(self) -> SignalFaults:
        """Faults of the stream's signals so far, whatever the surface."""
        return self._filter.faults

    def state_surface(self, statement: SurfaceStatement) -> None:
        """Record a person's statement; it holds from its sample on, which may be a later one.

        An unknown number is that of a new surface.
        """
        insort(self._statements, statement)  # in one step, as another thread may read the list

    def update(self, frames: RecordArray) -> list[SurfaceChange]:
        """Add the newest frames (n,); return the changes that they reveal."""
        changes = []
        while (
            self._statements
            and len(frames)
            and self._statements[0].sample <= int(frames["sequence"][-1])
        ):
            statement = self._statements.pop(0)
            before = frames["sequence"] < statement.sample
            changes += self._detect(frames[before])
            changes += self._follow(statement)
            frames = frames[~before]
        return changes + self._detect(frames)

    def _detect(self, frames: RecordArray) -> list[SurfaceChange]:
        changes = []
        for block in self._cutter.cut(self._filter.process(frames)) if len(frames) else ():
            self.stroked_s += BLOCK_S
            found = self._detector.update(block)
            if found is not None:
                self._found = self._go("new", self._largest + 1, *found)
                changes.append(self._found)
        return changes

    def _follow(self, statement: SurfaceStatement) -> list[SurfaceChange]:
        """Return the change that a person's statement makes, if any."""
        sample, number = statement
        if number == self.surface:
            return []
        found, self._found = self._found, None
        known = number in self.surfaces
        if known and found is not None and sample - found.at_sample <= self._named_samples:
            self.surfaces.remove(self.surface)
            return [self._go("identified", number, found.from_sample, sample)]
        self._detector.begin(sample)
        return [self._go("recalled" if known else "new", number, sample, sample)]

    def _go(
        self,
        kind: Literal["new", "recalled", "identified"],
        number: int,
        from_sample: int,
        at_sample: int,
        evidence: float | None = None,
    ) -> SurfaceChange:
        """Move to another surface, and return the change."""
        change = SurfaceChange(kind, self.surface, number, from_sample, at_sample, evidence)
        self.surface, self._largest = number, max(self._largest, number)
        self.surfaces = [n for n in self.surfaces if n != number] + [number]
        del self.surfaces[: -self._most]
        return change


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
    statements: Iterable[SurfaceStatement] = (),
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
    statements
        Statements of persons, which `mmt.texture.online.updates.surface_statements` returns
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
    for change in surface_changes(frames, settings, statements):
        yield FoundSurface(
            time_s=(change.at_sample - first) / settings.rate_hz,
            surface=change.surface,
            kind=change.kind,
            from_s=(change.from_sample - first) / settings.rate_hz,
        )


def surface_changes(
    frames: RecordArray, settings: ModellingSettings, statements: Iterable[SurfaceStatement] = ()
) -> Iterator[SurfaceChange]:
    """Yield each change of surface in frames (n,) by sample numbers, see `follow_surfaces`."""
    tracker = SurfaceTracker(settings, settings.surfaces or SurfaceSettings())
    for statement in statements:
        tracker.state_surface(statement)
    look = surface_check_frames(settings.rate_hz)
    numbering = StreamNumbering()
    for start in range(0, len(frames), look):
        yield from tracker.update(numbering.number(frames[start : start + look]))
