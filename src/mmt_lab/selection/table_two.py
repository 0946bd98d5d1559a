"""Selection from one of paper C's data sets: as published, by other readings, by the product."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray
from mmt.evaluation.held_out import Approximation, HeldOutRecording, approximate
from mmt.texture.signals.metrics import Spectra
from mmt_lab.selection.concatenated import ORDER as OWN_ORDER
from mmt_lab.selection.concatenated import (
    DataSet,
    NetworkModel,
    PaperRow,
    data_set,
    recording,
    segments_of,
    settings_of,
    stroke,
)
from mmt_lab.selection.knocks import SHARE
from mmt_methods.selection import ModelPoints, Selection, select
from mmt_methods.selection.published import SMOOTHING, select_published

FRESH_S: Final = 10.0
"""Length of the stroke that no model has seen."""

ORDER: Final = 32
"""Order of the filters in the published selection; the paper gives none. It is the usual one of a
model at 2 kHz. Both detection and false alarms grow with it: see `VARIATIONS`."""


@dataclass(frozen=True)
class Variation:
    """Another reading of the paper, or other data.

    ``share`` is the variance of a knock over that of its segment.
    """

    order: int = ORDER
    share: float = SHARE
    smoothing: float = SMOOTHING


AS_PUBLISHED: Final = "as published"

VARIATIONS: Final = {
    AS_PUBLISHED: Variation(),
    "filters of order 16": Variation(order=16),
    "filters of order 40": Variation(order=40),
    "network through every point": Variation(smoothing=0.0),
    "knocks of 0.2 of the variance": Variation(share=0.2),
    "knocks of 0.8 of the variance": Variation(share=0.8),
}


@dataclass(frozen=True)
class Removed:
    """Shares of the knocks and of the other points that were removed, and the compression."""

    detected: float
    false_alarms: float
    compression: float


@dataclass(frozen=True)
class Selected:
    """Results of one data set.

    ``variations`` are by the names of `VARIATIONS`, ``ours`` is the product's own selection;
    ``gfc`` and ``deviation`` are the mean over segments and its standard deviation, of all points
    and of the kept ones.
    """

    texture: str
    trials: int
    points: int
    minimal: int
    outliers: int
    variations: dict[str, Removed]
    ours: Removed
    gfc: tuple[float, float]
    deviation: tuple[float, float]
    ceiling: float

    @property
    def gain(self) -> float:
        """The relative difference of the two models' GFC."""
        return self.gfc[1] / self.gfc[0] - 1.0


def select_from(row: PaperRow, seed: int, spectra: Spectra) -> Selected:
    """Record a data set, select from it in every way, and score the published selection."""
    recorded = recording(row, seed)
    shares = {variation.share for variation in VARIATIONS.values()}
    sets = {share: data_set(row, seed, recorded, ORDER, share) for share in shares}
    results = {
        name: select_with_variation(variation, sets[variation.share])
        for name, variation in VARIATIONS.items()
    }
    found, result = sets[SHARE], results[AS_PUBLISHED][0]
    own = select(_of_order(found.data, OWN_ORDER))
    everything = np.ones(row.points, dtype=np.bool_)
    scored = [_score(found, row, seed, mask, spectra) for mask in (everything, result.kept)]
    gfc = [np.array([each.gfc for each in scores]) for scores in scored]
    return Selected(
        texture=row.name,
        trials=recorded.trials,
        points=len(found.data),
        minimal=int(result.minimal.sum()),
        outliers=int(found.knocked.sum()),
        variations={name: removed for name, (_, removed) in results.items()},
        ours=_removed(own.outlier, own.kept, found.knocked),
        gfc=(float(gfc[0].mean()), float(gfc[1].mean())),
        deviation=(float(gfc[0].std(ddof=1)), float(gfc[1].std(ddof=1))),
        ceiling=float(np.mean([each.gfc_ceiling for each in scored[0]])),
    )


def select_with_variation(variation: Variation, found: DataSet) -> tuple[Selection, Removed]:
    """Select as published from a data set, with a variation of the selection or its filters."""
    data = found.data if variation.order == ORDER else _of_order(found.data, variation.order)
    result = select_published(data, smoothing=variation.smoothing)
    return result, _removed(result.outlier, result.kept, found.knocked)


def _of_order(data: ModelPoints, order: int) -> ModelPoints:
    return ModelPoints.fitted(data.points, data.segments or (), order, data.rate_hz)


def _removed(outlier: BoolArray, kept: BoolArray, knocked: BoolArray) -> Removed:
    return Removed(
        float(outlier[knocked].mean()),
        float(outlier[~knocked].mean()),
        len(kept) / int(kept.sum()),
    )


def _score(
    found: DataSet, row: PaperRow, seed: int, mask: BoolArray, spectra: Spectra
) -> list[Approximation]:
    """Compare the segments of a fresh stroke with the rendering by a model of some points."""
    settings = settings_of(row, ORDER)
    chosen = np.zeros(len(found.pool.data), dtype=np.bool_)
    chosen[: row.points] = mask
    model = NetworkModel.from_contents(found.pool.model(chosen).contents)
    fresh = segments_of(stroke(row.surface, FRESH_S, seed, directed=row.directed), settings)
    recordings = [HeldOutRecording(one, settings.vibration_rate_hz, spectra) for one in fresh]
    return approximate(model, recordings, 0)
