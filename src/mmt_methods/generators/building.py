"""Build generators online: gather the observed data, and call the builder at each update."""

from collections.abc import Iterable

from mmt.core.arrays import RecordArray
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.online.updates import NewSamples
from mmt.texture.segmentation.segmenter import SampleRange, Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt_methods.generators.guarded import GuardedGenerator, told_as_fault
from mmt_methods.generators.protocol import Builder, Observed


class GeneratorModeller:
    """Build a generator from a stream of frames, as `OnlineModeller` builds a model.

    The frames are filtered and segmented in the same way. All frames are kept in memory, which
    suits sessions of minutes.

    Parameters
    ----------
    name
        Name of the generator in messages.
    builder
        See `mmt_methods.generators.protocol`.
    settings
        How frames are filtered and segmented; None takes the defaults.

    Attributes
    ----------
    generator
        Newest generator, None if there is none.
    """

    def __init__(
        self, name: str, builder: Builder, settings: ModellingSettings | None = None
    ) -> None:
        self._name, self._builder = name, builder
        self._settings = settings or ModellingSettings()
        self._modeller: OnlineModeller | None = None
        self._samples: list[AlignedBlock] = []
        self._segments: dict[SampleRange, Segment] = {}
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
            The builder has raised an exception, or has not returned a generator.
        """
        self._modeller = self._modeller or OnlineModeller(self._settings)
        return self.add(work.samples for work in self._modeller.segment(frames))

    def add(self, news: Iterable[NewSamples]) -> GuardedGenerator | None:
        """Add samples that were segmented elsewhere; return the same as `update`."""
        observed = self._observe(news)
        previous = None if self.generator is None else self.generator.generator
        with told_as_fault(self._name, "the builder"):
            made = self._builder(observed, previous)
        if made is None:
            self.generator = None
        elif made is not previous:
            self.generator = GuardedGenerator(self._name, made)
        return self.generator

    def _observe(self, news: Iterable[NewSamples]) -> Observed:
        time_s = 0.0
        for each in news:
            time_s = each.time_s
            self._samples += each.observed
            for key in each.removed:
                self._segments.pop(key, None)
            self._segments |= {one.span: one for one in each.added}
        self._samples = [AlignedBlock.concatenate(self._samples)]
        return Observed(
            time_s=time_s,
            rate_hz=self._settings.vibration_rate_hz,
            inputs=self._settings.inputs,
            samples=self._samples[0],
            segments=tuple(self._segments.values()),
        )
