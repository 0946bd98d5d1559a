"""The task that fits segments: filters by Burg's method, as line spectral frequencies."""

from mmt.leader.modelling.stage import StageTask


class FittingTask(StageTask):
    """Fits the segments of each update."""

    stage = "fit"
