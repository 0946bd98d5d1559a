"""The task that judges how complete each new model is."""

from mmt.leader.modelling.stage import StageTask


class CompletingTask(StageTask):
    """Judges the model of each update."""

    stage = "judge"
