"""The task that judges how complete each new model is."""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from mmt.leader.modelling.stage import Activity, Item, ItemQueue, StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work


def _judge(work: "Work") -> None:
    work.modeller.judge(work)


class CompletingTask(StageTask):
    """Judge the model of one update after the other; parameters as of `StageTask`."""

    def __init__(
        self,
        worker: Executor,
        queue: ItemQueue,
        activity: Activity,
        deliver: Callable[[Item], None],
    ) -> None:
        super().__init__((_judge,), worker, queue, activity, deliver)
