"""When is a model complete: the share of an operator's strokes whose level is expected right.

In place of distances, the posterior of the level (`mmt.texture.field.level_process`) says at each
stroke how likely its level is within one JND of the truth; the mean of that, weighted by where
this operator strokes (`mmt.texture.field.stroking_density`), is the criterion's value. It is the
expectation of a share that evaluations measure, `mmt lab compare`, which shows how well it
is calibrated.

What it leaves out: the spectrum's shape, whose error has no posterior here, and what the stream
does not tell, such as vibration far below the corner of the modelling's high-pass.
"""

import numpy as np

from mmt.texture.completion.criterion import Progress, Thresholds
from mmt.texture.completion.grid import completion_grid
from mmt.texture.field.level_outlook import outlook
from mmt.texture.field.stroking_density import StrokingDensity
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock


class UncertaintyCriterion(Thresholds):
    """Judge a model by the uncertainty of its level; see `Criterion`.

    Parameters
    ----------
    settings
        Of the modelling: inputs, thresholds, what counts as stroking.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        super().__init__(settings.scale)
        self.grid = completion_grid(3 if settings.inputs == "anisotropic" else 2)
        self.density = StrokingDensity(
            self.grid, settings.least_speed_mm_s, settings.least_force_n, settings.rate_hz
        )
        nothing = self.grid.mean_of_cells(np.zeros(len(self.grid)))
        self.progress = self._nothing = Progress(self.scale, 0.0, tuple(nothing.tolist()))

    def observe(self, block: AlignedBlock) -> None:
        """Take the newest of the stream."""
        self.density.add(block)

    def update(self, model: TextureModel | None, time_s: float) -> None:
        """Take the model at a session time; without one, or without any power, nothing is right."""
        process = None if model is None else model.level_process
        if process is None:
            self.progress = self._nothing
            return
        weights = self.density.weights
        found = outlook(process, self.grid, weights)
        self.progress = Progress(
            scale=self.scale,
            value=found.share(weights),
            cells=tuple(self.grid.mean_of_cells(found.right).tolist()),
            advice=tuple(self.grid.inputs[int(np.argmax(found.gain))].tolist()),
        )
        self.meet(self.progress.value, time_s)
