"""The task that builds the interpolated model from new fits.

The task chooses the fits that the model is made of and triangulates them (Delaunay, or as the
scene says). The tick renders from the newest model that was put to use: a snapshot that is
replaced by one assignment and never changed.
"""

from mmt.leader.modelling.stage import StageTask


class SynthesizingTask(StageTask):
    """Build the interpolated model from the fits of one update after the other.

    The model is a snapshot that rendering gets once it is judged.
    """

    stage = "build"
