"""The task that judges how complete each new model is."""

from mmt.leader.modelling.stage import StageTask


class CompletingTask(StageTask):
    """Judge the model of one update after the other."""

    stage = "judge"
