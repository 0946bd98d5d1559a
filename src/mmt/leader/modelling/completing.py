"""The task that judges how complete each new model is."""

from typing import TYPE_CHECKING

from mmt.leader.modelling.stage import StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work


class CompletingTask(StageTask):
    """Judge the model of one update after the other."""

    def work_on(self, work: "Work") -> None:
        """Judge the model, and set what has come of the update."""
        work.modeller.judge(work)
