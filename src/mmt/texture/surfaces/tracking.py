"""From frames to the surface under the tool: filter, cut into blocks, detect."""

from mmt.core.arrays import RecordArray
from mmt.texture.model.inputs import InputSpace
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.surfaces.blocks import BLOCK, BlockCutter
from mmt.texture.surfaces.changes import SurfaceChange
from mmt.texture.surfaces.detection import SurfaceDetector


class SurfaceTracker:
    """Follow a stream of frames over several surfaces.

    Cost: a block of 100 ms takes about 3 ms with two to six known surfaces, where it has a heading
    12 to 16 ms on the average, 50 near the end of a trial and 170 at the worst.

    Parameters
    ----------
    modelling
        Its axes, its least speed and force, and its inputs.
    settings
        Of the detection.
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
        """Seconds of stroking that were looked at."""

    @property
    def surface(self) -> int:
        """The number of the surface that the tool is taken to be on."""
        return self.detector.current

    def update(self, frames: RecordArray) -> list[SurfaceChange]:
        """Take the newest frames (n,); return the changes that they bring to light."""
        changes = []
        for block in self._cutter.cut(self._filter.process(frames)):
            self.stroked_s += BLOCK / 1000.0
            change = self.detector.update(block)
            if change is not None:
                changes.append(change)
        return changes
