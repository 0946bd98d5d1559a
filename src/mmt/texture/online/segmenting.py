"""The first stage of an update: frames are filtered, and cut into segments."""

from collections.abc import Callable, Iterator

from mmt.core.arrays import RecordArray
from mmt.texture.online.work import Stopwatch, UpdateSteps, Work
from mmt.texture.segmentation.segmenter import OnlineSegmenter, segmentation_settings
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.faults import SignalFaults
from mmt.texture.signals.filtering import StreamFilter
from mmt.texture.signals.noise_floor import NoiseFloor


class SegmentingStage:
    """Filter the stream and find its segments.

    Cost: O(new samples).

    Parameters
    ----------
    settings
        Settings of the modelling.
    accept
        Asked for each segment whether it may enter the model; None accepts all.
    """

    def __init__(
        self, settings: ModellingSettings, accept: Callable[[Segment], bool] | None
    ) -> None:
        self._rate_hz = settings.rate_hz
        self._accept = accept
        self._filter = StreamFilter.of(settings)
        self._segmenter = OnlineSegmenter(
            segmentation_settings(settings), overlap_samples=settings.overlap_samples
        )
        self._noise = NoiseFloor()
        self.first_sequence: int | None = None
        """Number of the first frame, None before it."""
        self.time_s = 0.0
        """Session time of the newest frame."""

    @property
    def delay_samples(self) -> int:
        """Samples by which segments lag behind the newest frame, from the filters."""
        return self._filter.delay_samples

    @property
    def noise_power(self) -> float:
        """The sensor's noise in (m/s2)^2, 0 as long as it is not known."""
        return self._noise.power

    @property
    def faults(self) -> SignalFaults:
        """What was no measurement so far."""
        return self._filter.faults

    def segment(self, modeller: UpdateSteps, frames: RecordArray) -> Iterator[Work | None]:
        """Filter and segment frames (n,); None after the filters, the work for an update last.

        A service that must keep its ticks runs the steps one by one, so that the interpreter
        lock is never contended for longer than one of them.
        """
        clock = Stopwatch()
        if len(frames):
            if self.first_sequence is None:
                self.first_sequence = int(frames["sequence"][0])
            elapsed = int(frames["sequence"][-1]) + 1 - self.first_sequence
            self.time_s = elapsed / self._rate_hz
        aligned = self._filter.process(frames)
        self._noise.update(aligned)
        clock.lap("filter")
        yield None
        clock.resume()
        change = self._segmenter.update(aligned)
        accept = self._accept
        added = [s for s in change.added if accept is None or accept(s)]
        held_out = [s for s in change.added if accept is not None and not accept(s)]
        clock.lap("segment")
        yield Work(
            modeller=modeller,
            time_s=self.time_s,
            observed=[aligned],
            added=added,
            removed=[(s.start, s.stop) for s in change.removed],
            noise_power=self._noise.power,
            faults=self.faults,
            held_out=[(s.start, s.stop) for s in held_out],
            durations_s=clock.laps,
        )
