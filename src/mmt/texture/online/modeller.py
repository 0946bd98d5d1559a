"""The online update of a texture model: stream in, immutable models out.

Awan et al., section V.C: once a period the newest samples are filtered and cut into segments
(`SegmentingStage`), fitted (`FittingStage`), and a new model is triangulated (`BuildingStage`),
which a criterion of completion judges (`CompletionStage`). `OnlineModeller` holds the four stages
of one model. The evaluation of recorded sessions runs them one after the other (`update`); the
live leader runs each in a task of its own, and comes to the same model to the bit.

The model has `LARGEST_MODEL` samples at most, so that neither memory nor the cost of an update
grows without end where the criteria are never met.
"""

from collections.abc import Callable, Iterator

from mmt.core.arrays import RecordArray
from mmt.texture.completion.criterion import Criterion
from mmt.texture.model.fits import Fit
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.building import BuildingStage
from mmt.texture.online.completing import CompletionStage
from mmt.texture.online.fitting import LARGEST_MODEL, FittingStage
from mmt.texture.online.methods import method_of
from mmt.texture.online.segmenting import SegmentingStage
from mmt.texture.online.work import ModelUpdate, SegmentRange, Work
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import ModellingSettings

__all__ = ["LARGEST_MODEL", "ModelUpdate", "OnlineModeller", "carry_out"]


class OnlineModeller:
    """Build a texture model from a stream of frames.

    Parameters
    ----------
    settings
        See `ModellingSettings`.
    accept
        Asked for each segment whether it may enter the model; the evaluation holds
        segments out with it.
    deferred
        Whether a model is made only when it is asked for; see `BuildingStage`.
    until_start
        Whether the criterion is of no interest once it has started.
    """

    in_step = False
    """Whether `segment` must see what came of each update before it goes on."""

    def __init__(
        self,
        settings: ModellingSettings | None = None,
        accept: Callable[[Segment], bool] | None = None,
        *,
        deferred: bool = False,
        until_start: bool = False,
    ) -> None:
        self.settings = settings or ModellingSettings()
        self.space = InputSpace(self.settings.inputs)
        self._segmenting = SegmentingStage(self.settings, accept)
        self._method = method_of(self.settings, deferred=deferred)
        self._fitting = FittingStage(self.settings, self._method)
        self._building = BuildingStage(self.settings, self._method, deferred=deferred)
        self._completing = CompletionStage(self.settings, self._method, until_start=until_start)

    @property
    def completion(self) -> Criterion:
        """The criterion of completion, as of the newest update."""
        return self._method.criterion

    @property
    def fits(self) -> dict[SegmentRange, Fit]:
        """The fits that there are, by the range of their segments."""
        return self._fitting.fits

    @property
    def order(self) -> int | None:
        """The common order of the fits, None before an automatic one is chosen."""
        return self._fitting.order

    @property
    def model(self) -> TextureModel | None:
        """The newest model, None before the first fit."""
        return self._building.model

    @property
    def delay_samples(self) -> int:
        """Samples by which segments lag behind the newest frame, from the filters."""
        return self._segmenting.delay_samples

    @property
    def fits_by_verdict(self) -> bool:
        """Whether fitting must wait until the update before is judged.

        So it is as long as an automatic order follows the data until the start criterion is
        met, and where a selection sends fits away.
        """
        follows = self.settings.order == "auto" and not self.completion.started
        return follows or self._building.selects

    def update(self, frames: RecordArray) -> ModelUpdate:
        """Add the newest frames and return the new state.

        Parameters
        ----------
        frames
            Shape (n,), with position, force and acceleration; in order, with jumps in
            ``sequence`` where frames are missing. May be empty.
        """
        update = carry_out(self.segment(frames))
        assert update is not None  # noqa: S101 - every call gives work
        return update

    # --- the stages; the work goes through them in this order

    def segment(self, frames: RecordArray) -> Iterator[Work | None]:
        """Filter and segment frames (n,); see `SegmentingStage.segment`."""
        return self._segmenting.segment(self, frames)

    def forget(self, from_sample: int) -> Work:
        """Return the work of taking out what reaches beyond a sample, which is of another surface.

        A criterion that only those samples have met will be no longer met.

        Parameters
        ----------
        from_sample
            The first sequence number that is not of this surface.
        """
        stage = self._segmenting
        known = stage.noise_power, stage.faults
        return Work(self, stage.time_s, [], [], [], *known, forget_from=from_sample)

    def fit(self, work: Work) -> None:
        """Fit the new segments."""
        self._fitting.fit(work, started=self.completion.started)

    def choose(self, work: Work) -> None:
        """Choose the fits of the model."""
        self._fitting.remove(self._building.choose(work))

    def build(self, work: Work) -> None:
        """Build the model of the chosen fits."""
        self._building.build(work)

    def judge(self, work: Work) -> None:
        """Judge the model and set ``work.update``."""
        self._completing.judge(work, self._segmenting.first_sequence or 0)


def carry_out(steps: Iterator[Work | None]) -> ModelUpdate | None:
    """Run every stage of each piece of work, and return the last update that is announced."""
    update = None
    for work in steps:
        if work is None:
            continue
        modeller = work.modeller
        modeller.fit(work)
        modeller.choose(work)
        modeller.build(work)
        modeller.judge(work)
        update = work.update if work.announced else update
    return update
