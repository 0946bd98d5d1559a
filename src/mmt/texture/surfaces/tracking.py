"""Surface tracking from frames: detected changes of surface, and statements of persons."""

from bisect import insort
from typing import Final, Literal

from mmt.core.arrays import RecordArray
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.online.surface_changes import SaidSurface, SurfaceChange
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.signals.faults import SignalFaults
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.space.inputs import InputSpace
from mmt.texture.surfaces.blocks import SurfaceBlockCutter
from mmt.texture.surfaces.detection import SurfaceDetector

NAMED_S: Final = 4.0
"""Time after a detected change in which a person's statement is on the surface since then."""


class SurfaceTracker:
    """Tracker of the surface under the tool in a stream of frames.

    A detected change begins a new surface. A return to a known surface is not detected: a person
    says it (`say`). Within `NAMED_S` of a detected change the statement is on the new surface,
    which then was the named one all along. Otherwise it holds from the named sample on.

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
        self._said: list[SaidSurface] = []
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

    def say(self, said: SaidSurface) -> None:
        """Record a person's statement; it holds from its sample on, which may be a later one.

        An unknown number is that of a new surface.
        """
        insort(self._said, said)  # in one step, as another thread may read the list

    def update(self, frames: RecordArray) -> list[SurfaceChange]:
        """Add the newest frames (n,); return the changes that they reveal."""
        changes = []
        while self._said and len(frames) and self._said[0].sample <= int(frames["sequence"][-1]):
            said = self._said.pop(0)
            before = frames["sequence"] < said.sample
            changes += self._detect(frames[before])
            changes += self._follow(said)
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

    def _follow(self, said: SaidSurface) -> list[SurfaceChange]:
        """Return the change that a person's statement makes, if any."""
        sample, number = said
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
