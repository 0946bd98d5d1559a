"""The two ways to model a texture from a stream, and the calls that both have.

Segments become fitted samples (`add`), these a model (`model`), which says the spectrum at a point
(`TextureModel.spectrum`), and how complete it is (`judge`, `criterion`). All else that the online
modelling does is the same for both.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from mmt.core.arrays import FloatArray
from mmt.texture.completion.criterion import Criterion
from mmt.texture.completion.distance import CompletionMonitor
from mmt.texture.model.fits import Fit, fit_segments, unpacked
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.work import DEFERRED, Made, Stopwatch, Work
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.space.inputs import InputSpace
from mmt.texture.touch_down.fitting import fit_transient

if TYPE_CHECKING:
    from mmt.texture.field.cells import FieldCells
    from mmt.texture.touch_down.finding import TouchDown

ModelMaker = Callable[[], TextureModel]


class ModellingMethod(ABC):
    """A way to model a texture, with what it keeps of one model's stream.

    The calls belong to different stages of an update, which may run at the same time.

    Parameters
    ----------
    settings
        Settings of the modelling.
    """

    criterion: Criterion
    """How complete the model is, as of the newest update."""
    _behind_high_pass = False

    def __init__(self, settings: ModellingSettings) -> None:
        self._settings = settings

    def add(self, segments: Sequence[Segment], numbers: Iterator[int]) -> list[Fit]:
        """Return segments as fitted samples, each with its own number."""
        behind = self._behind_high_pass
        return fit_segments(segments, numbers, self._settings, behind_high_pass=behind)

    def _maker(self, work: Work, cells: "Callable[[], FieldCells] | None" = None) -> ModelMaker:
        """Return what makes the model of the fits, at least one, until the next update."""
        packed = [fit.packed for fit in work.fits]
        noise_power, touch_downs = work.noise_power, work.touch_downs
        return lambda: made(self._settings, packed, noise_power, cells and cells(), touch_downs)

    @abstractmethod
    def model(self, work: Work, *, changed: bool) -> ModelMaker | None:
        """Return what makes the model of an update, None where it is the one before.

        Parameters
        ----------
        work
            What the update has observed, and the fits that the model is made of.
        changed
            Whether these are other ones than before.
        """

    @abstractmethod
    def judge(self, work: Work, points: FloatArray, *, anew: bool) -> None:
        """Evaluate the criterion, where ``anew``, after an update.

        Parameters
        ----------
        work
            With what the update has observed, and what gives its model.
        points
            Normalised inputs of the model's samples, shape (n, d).
        anew
            False where the update has only taken away what was not there.
        """


def method_of(settings: ModellingSettings) -> ModellingMethod:
    """Return the method that settings name, with nothing of a stream yet."""
    return (PublishedMethod if settings.method == "published" else FieldMethod)(settings)


class PublishedMethod(ModellingMethod):
    """The model of papers A and B: what was measured, interpolated, until it is densely sampled."""

    _behind_high_pass = True

    def __init__(self, settings: ModellingSettings) -> None:
        super().__init__(settings)
        self.criterion: CompletionMonitor = CompletionMonitor(settings)

    def model(self, work: Work, *, changed: bool) -> ModelMaker | None:
        """See `ModellingMethod`."""
        return self._maker(work) if changed else None

    def judge(self, work: Work, points: FloatArray, *, anew: bool) -> None:
        """See `ModellingMethod`; this criterion depends on the samples alone."""
        if anew:
            self.criterion.update(points, work.time_s)


class FieldMethod(ModellingMethod):
    """The model whose level is a field that knows its error, until enough strokes are right."""

    def __init__(self, settings: ModellingSettings) -> None:
        from mmt.texture.completion.uncertainty import UncertaintyCriterion
        from mmt.texture.field.blocks import BlockCutter
        from mmt.texture.online.gathering import BlockSums

        super().__init__(settings)
        self.criterion: UncertaintyCriterion = UncertaintyCriterion(settings)
        self._cutter, self._sums = BlockCutter(settings), BlockSums(settings)

    def model(self, work: Work, *, changed: bool) -> ModelMaker | None:
        """See `ModellingMethod`."""
        work.blocks = self._cutter.cut(work.observed)
        felt = self._sums.add(work.blocks, work.forget_from)
        return self._maker(work, self._sums.cells) if changed or (felt and work.fits) else None

    def judge(self, work: Work, points: FloatArray, *, anew: bool) -> None:
        """See `ModellingMethod`; evaluated as often as the strokes are news."""
        del points
        for block in work.observed:
            self.criterion.density.add(block)
        if anew and (work.forget_from is not None or self.criterion.due):
            clock, model = Stopwatch(work.durations_s), work.source()
            if model is not None and not isinstance(work.source, Made):  # that is deferred
                _ = model.level_field
                clock.lap(DEFERRED)
            self.criterion.update(model, work.time_s)


def made(
    settings: ModellingSettings,
    packed: Sequence[bytes],
    noise_power: float,
    cells: "FieldCells | None",
    touch_downs: "Sequence[TouchDown]" = (),
) -> TextureModel:
    """Return the model of fits, at least one, from what `Fit.packed` is of each, and of cells."""
    return TextureModel(
        replace(unpacked(packed, InputSpace(settings.inputs)), noise_power=noise_power),
        method=settings.method,
        field=cells,
        rate_hz=settings.vibration_rate_hz,
        touch_down=fit_transient(touch_downs, settings.vibration_rate_hz),
        at_once=False,
    )
