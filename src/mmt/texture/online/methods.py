"""The two methods of modelling a texture from a stream, and their common interface.

A method says when the model changes (`changes`), builds it of the fits (`model`), and judges how
complete it is (`judge`, `criterion`). The rest of the online modelling is the same for both.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from mmt.core.arrays import FloatArray
from mmt.texture.completion.criterion import Criterion
from mmt.texture.completion.distance import CompletionMonitor
from mmt.texture.model.fits import unpacked
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.updates import DEFERRED, ReadyModel, Stopwatch, UpdateWork
from mmt.texture.settings import ModellingSettings
from mmt.texture.space import InputSpace
from mmt.texture.touch_down.fitting import TouchDown, fit_transient

if TYPE_CHECKING:
    from mmt.texture.field.cells import FieldCells


class ModellingMethod(ABC):
    """Method of modelling a texture, with its state for one model.

    The calls belong to different stages of an update, which may run at the same time.

    Parameters
    ----------
    settings
        Settings of the modelling.
    """

    criterion: Criterion
    """Completion criterion, as of the newest update."""

    def __init__(self, settings: ModellingSettings) -> None:
        self._settings = settings

    def model(self, work: UpdateWork) -> TextureModel:
        """Return the model of an update's fits, at least one."""
        packed = [fit.packed for fit in work.fits]
        cells = self._cells()
        return build_from_packed(self._settings, packed, work.noise_power, cells, work.touch_downs)

    def _cells(self) -> "FieldCells | None":
        """Return the blocks of the model, None if the method uses none."""
        return None

    @abstractmethod
    def changes(self, work: UpdateWork, *, changed: bool) -> bool:
        """Take in the observed samples of an update, and return whether the model changes.

        ``changed`` says whether its fits or touch-downs have.
        """

    @abstractmethod
    def judge(self, work: UpdateWork, points: FloatArray, *, anew: bool) -> None:
        """Evaluate the criterion after an update, if ``anew``.

        Parameters
        ----------
        work
            Work with the observed samples of the update, and the source of its model.
        points
            Normalised inputs of the model's samples, shape (n, d).
        anew
            False if the update was to remove samples, but there were none.
        """


def method_of(settings: ModellingSettings) -> ModellingMethod:
    """Return a new instance of the method that settings name."""
    return (PublishedMethod if settings.method == "published" else FieldMethod)(settings)


class PublishedMethod(ModellingMethod):
    """Papers A and B: measured samples are interpolated; complete if they are dense enough."""

    def __init__(self, settings: ModellingSettings) -> None:
        super().__init__(settings)
        self.criterion: CompletionMonitor = CompletionMonitor(settings)

    def changes(self, work: UpdateWork, *, changed: bool) -> bool:
        """See `ModellingMethod`."""
        del work
        return changed

    def judge(self, work: UpdateWork, points: FloatArray, *, anew: bool) -> None:
        """See `ModellingMethod`; this criterion depends on the samples alone."""
        if anew:
            self.criterion.update(points, work.time_s)


class FieldMethod(ModellingMethod):
    """Level as a field with a known error; complete if enough strokes are expected right."""

    def __init__(self, settings: ModellingSettings) -> None:
        from mmt.texture.completion.uncertainty import UncertaintyCriterion
        from mmt.texture.field.blocks import BlockCutter, BlockSums

        super().__init__(settings)
        self.criterion: UncertaintyCriterion = UncertaintyCriterion(settings)
        self._cutter, self._sums = BlockCutter(settings), BlockSums(settings)

    def changes(self, work: UpdateWork, *, changed: bool) -> bool:
        """See `ModellingMethod`."""
        work.blocks = self._cutter.cut(work.observed)
        felt = self._sums.add(work.blocks, work.forget_from)
        return changed or (felt and bool(work.fits))

    def _cells(self) -> "FieldCells":
        return self._sums.cells()

    def judge(self, work: UpdateWork, points: FloatArray, *, anew: bool) -> None:
        """See `ModellingMethod`; evaluated only after enough new stroking."""
        del points
        for block in work.observed:
            self.criterion.density.add(block)
        if anew and (work.forget_from is not None or self.criterion.due):
            clock, model = Stopwatch(work.durations_s), work.source()
            if model is not None and not isinstance(work.source, ReadyModel):  # deferred
                _ = model.level_field
                clock.lap(DEFERRED)
            self.criterion.update(model, work.time_s)


def build_from_packed(
    settings: ModellingSettings,
    packed: Sequence[bytes],
    noise_power: float,
    cells: "FieldCells | None",
    touch_downs: Sequence[TouchDown] = (),
) -> TextureModel:
    """Return the model of cells and of fits, at least one, given as their `Fit.packed`."""
    return TextureModel(
        replace(unpacked(packed, InputSpace(settings.inputs)), noise_power=noise_power),
        method=settings.method,
        field=cells,
        rate_hz=settings.vibration_rate_hz,
        touch_down=fit_transient(touch_downs, settings.vibration_rate_hz),
        at_once=False,
    )
