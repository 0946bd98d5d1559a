"""Surface tracking from frames: filter, cut into blocks, detect changes."""

from mmt.core.arrays import RecordArray
from mmt.texture.field.blocks import BLOCK_S
from mmt.texture.model.inputs import InputSpace
from mmt.texture.settings import ModellingSettings, SurfaceSettings
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.surfaces.blocks import BlockCutter
from mmt.texture.surfaces.changes import SurfaceChange
from mmt.texture.surfaces.detection import SurfaceDetector


class SurfaceTracker:
    """Tracker of the surface under the tool in a stream of frames.

    Cost: a second of stroking takes 50 to 80 ms with one known surface and 100 ms with twenty,
    which are compared only where an unknown one would explain the newest blocks better.

    Parameters
    ----------
    modelling
        Its axes, its least speed and force, and its inputs.
    settings
        Settings of the detection.
    """

    def __init__(self, modelling: ModellingSettings, settings: SurfaceSettings) -> None:
        self._filter = StreamFilter.of(modelling)
        self._cutter = BlockCutter(modelling)
        self.detector = SurfaceDetector(
            settings.false_alarms_per_hour,
            settings.most,
            by_heading=InputSpace(modelling.inputs).directed,
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
            self.stroked_s += BLOCK_S
            change = self.detector.update(block)
            if change is not None:
                changes.append(change)
        return changes
