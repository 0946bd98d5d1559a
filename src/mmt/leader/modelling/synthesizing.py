"""The task that builds the interpolated model from new fits.

The task chooses the fits of which the model consists, and triangulates them (Delaunay, or as the
scene says). The tick renders from the newest model that was put to use: a snapshot that is
replaced by one assignment and never changed.
"""

from mmt.leader.modelling.stage import StageTask


class SynthesizingTask(StageTask):
    """Builds the interpolated model from the fits of each update.

    The renderer gets the model, a snapshot, once it is judged.
    """

    stage = "build"
