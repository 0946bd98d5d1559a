"""Surface tracking from frames: filter, cut into blocks, detect changes."""

from mmt.core.arrays import RecordArray
from mmt.texture.model.inputs import InputSpace
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.surfaces.blocks import BLOCK, BlockCutter
from mmt.texture.surfaces.changes import SurfaceChange
from mmt.texture.surfaces.detection import SurfaceDetector


class SurfaceTracker:
    """Tracker of the surface under the tool in a stream of frames.

    Cost: a block of 100 ms takes about 3 ms with two to six known surfaces, where it has a heading
    12 to 16 ms on the average, 50 near the end of a trial and 170 at the worst.

    Parameters
    ----------
    modelling
        Its axes, its least speed and force, and its inputs.
    settings
        Settings of the detection.
    """

    def __init__(self, modelling: ModellingSettings, settings: SurfaceSettings) -> None:
        self._filter = StreamFilter(
            normal=modelling.normal, axis=modelling.axis, rate_hz=modelling.rate_hz
        )
        by_heading = InputSpace(modelling.inputs).directed
        self._cutter = BlockCutter(
            modelling.least_speed_mm_s, modelling.least_force_n, by_heading=by_heading
        )
        self.detector = SurfaceDetector(
            settings.false_alarms_per_hour, settings.most, by_heading=by_heading
        )
        self.stroked_s = 0.0
        """Seconds of stroking analysed."""

    @property
    def surface(self) -> int:
        """The number of the surface that the tool is taken to be on."""
        return self.detector.current

    def update(self, frames: RecordArray) -> list[SurfaceChange]:
        """Add the newest frames (n,); return the changes that they reveal."""
        changes = []
        for block in self._cutter.cut(self._filter.process(frames)):
            self.stroked_s += BLOCK / 1000.0
            change = self.detector.update(block)
            if change is not None:
                changes.append(change)
        return changes
