"""The last stage of an update: how far the model is, by the criterion in use."""

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.completion import make_criterion
from mmt.texture.completion.criterion import Criterion
from mmt.texture.completion.distance import CompletionMonitor, distance_sum
from mmt.texture.model.fits import points_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.online.work import ModelUpdate, Stopwatch, Work
from mmt.texture.settings import ModellingSettings


class CompletionStage:
    """Judge each new model, and say what the update has done.

    Parameters
    ----------
    settings
        Settings of the modelling.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        self._space = InputSpace(settings.inputs)
        self._rate_hz = settings.rate_hz
        self.criterion: Criterion = make_criterion(settings)

    def judge(self, work: Work, first_sequence: int) -> None:
        """Judge the model of an update, and set what has come of the update.

        A criterion that only samples of another surface have met is no longer met.

        Parameters
        ----------
        work
            With a model, or None where there is none.
        first_sequence
            Number of the stream's first frame.
        """
        clock = Stopwatch(work.durations_s)
        for block in work.observed:
            self.criterion.observe(block)
        points = np.empty((0, self._space.dimensions))
        if work.chosen:
            points = points_of(work.chosen, self._space)
        if work.forget_from is None:
            self._update(work, points, anew=self.criterion.due)
        elif work.removed_count:
            self._update(work, points, anew=True)
            self.criterion.revoke_since((work.forget_from - first_sequence) / self._rate_hz)
        clock.lap("completion")
        work.update = ModelUpdate(
            time_s=work.time_s if work.session_time_s is None else work.session_time_s,
            samples=len(work.chosen),
            added=len(work.added),
            removed=work.removed_count,
            distance=distance_sum(points),
            progress=self.criterion.progress,
            order=work.order,
            started=self.criterion.started,
            stopped=self.criterion.stopped,
            source=work.source,
            durations_s=work.durations_s,
            outliers=work.outliers,
            redundant=work.redundant,
            surface=work.surface,
            changes=work.changes,
            left=work.left,
        )

    def _update(self, work: Work, points: FloatArray, *, anew: bool) -> None:
        """Evaluate the criterion; the published one asks for no model, which may be deferred."""
        if isinstance(self.criterion, CompletionMonitor):
            self.criterion.update_points(points, work.time_s)
        elif anew:
            self.criterion.update(work.source(), work.time_s)
