"""Build generators online: gather what is observed, and ask the builder at each update."""

from mmt.core.arrays import RecordArray
from mmt.texture.generators.guarded import GuardedGenerator, raised
from mmt.texture.generators.protocol import Builder, Observed, VibrationGenerator
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.online.work import SegmentRange
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock


class GeneratorModeller:
    """Build a generator from a stream of frames, as `OnlineModeller` builds a model.

    The frames are filtered and segmented in the same way. All of them are kept: it is for
    sessions of minutes.

    Parameters
    ----------
    name
        What the generator is called in messages.
    builder
        See `mmt.texture.generators.protocol`.
    settings
        How frames are filtered and segmented; None takes the defaults.
    limit_m_s2
        Bound on the generator's output.

    Attributes
    ----------
    generator
        The newest, None before there is one.
    """

    def __init__(
        self,
        name: str,
        builder: Builder,
        settings: ModellingSettings | None = None,
        *,
        limit_m_s2: float = 60.0,
    ) -> None:
        self._name, self._builder, self._limit_m_s2 = name, builder, limit_m_s2
        self._settings = settings or ModellingSettings()
        self._modeller = OnlineModeller(self._settings)
        self._samples: list[AlignedBlock] = []
        self._segments: dict[SegmentRange, Segment] = {}
        self.generator: GuardedGenerator | None = None

    @property
    def segments(self) -> int:
        """Number of segments that the newest generator was built from."""
        return len(self._segments)

    def update(self, frames: RecordArray) -> GuardedGenerator | None:
        """Add the newest frames and return the new generator, None as long as there is none.

        Parameters
        ----------
        frames
            As for `OnlineModeller.update`.

        Raises
        ------
        GeneratorFault
            The builder has raised, or what it returned is no generator.
        """
        observed = self._observe(frames)
        previous = None if self.generator is None else self.generator.generator
        made = self._build(observed, previous)
        if made is None:
            self.generator = None
        elif made is not previous:
            self.generator = GuardedGenerator(self._name, made, limit_m_s2=self._limit_m_s2)
        return self.generator

    def _observe(self, frames: RecordArray) -> Observed:
        time_s = 0.0
        for work in self._modeller.segment(frames):
            if work is None:
                continue
            time_s = work.time_s
            self._samples += work.observed
            for key in work.removed:
                self._segments.pop(key, None)
            self._segments |= {(each.start, each.stop): each for each in work.added}
        self._samples = [AlignedBlock.concatenate(self._samples)]
        return Observed(
            time_s=time_s,
            rate_hz=self._settings.rate_hz,
            inputs=self._settings.inputs,
            samples=self._samples[0],
            segments=tuple(self._segments.values()),
        )

    def _build(
        self, observed: Observed, previous: VibrationGenerator | None
    ) -> VibrationGenerator | None:
        try:
            return self._builder(observed, previous)
        except Exception as error:
            raise raised(self._name, "the builder", error) from error
