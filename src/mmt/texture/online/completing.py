"""The last stage of an update: how far the model is, by the criterion in use."""

import numpy as np

from mmt.texture.completion.distance import distance_sum
from mmt.texture.model.fits import points_of
from mmt.texture.model.inputs import InputSpace
from mmt.texture.online.methods import ModellingMethod
from mmt.texture.online.work import DEFERRED, ModelUpdate, Stopwatch, Work
from mmt.texture.settings import ModellingSettings


class CompletionStage:
    """Judge each new model, and say what the update has done.

    Parameters
    ----------
    settings
        Settings of the modelling.
    method
        How to model.
    until_start
        Whether the criterion is of no interest once it has started.
    """

    def __init__(
        self, settings: ModellingSettings, method: ModellingMethod, *, until_start: bool = False
    ) -> None:
        self._until_start = until_start
        self._space = InputSpace(settings.inputs)
        self._rate_hz = settings.rate_hz
        self._method = method

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
        criterion = self._method.criterion
        points = np.empty((0, self._space.dimensions))
        if work.chosen:
            points = points_of(work.chosen, self._space)
        revoked = work.forget_from is not None and work.removed_count > 0
        if not (self._until_start and criterion.started):
            self._method.judge(work, points, anew=revoked or work.forget_from is None)
        if revoked and work.forget_from is not None:
            criterion.revoke_since((work.forget_from - first_sequence) / self._rate_hz)
        clock.lap("completion")
        work.durations_s["completion"] -= work.durations_s.get(DEFERRED, 0.0)
        work.update = ModelUpdate(
            time_s=work.time_s if work.session_time_s is None else work.session_time_s,
            samples=len(work.chosen),
            added=len(work.added),
            removed=work.removed_count,
            distance=distance_sum(points),
            progress=criterion.progress,
            order=work.order,
            started=criterion.started,
            stopped=criterion.stopped,
            source=work.source,
            durations_s=work.durations_s,
            outliers=work.outliers,
            redundant=work.redundant,
            surface=work.surface,
            changes=work.changes,
            left=work.left,
        )
