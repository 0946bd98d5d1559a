"""The task that fits: segments in, filters of Burg's method as line spectral frequencies out."""

from mmt.leader.modelling.stage import StageTask


class FittingTask(StageTask):
    """Fit the segments of one update after the other."""

    stage = "fit"
