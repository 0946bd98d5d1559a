"""The task that fits: segments in, filters of Burg's method as line spectral frequencies out."""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from mmt.leader.modelling.stage import Activity, Item, ItemQueue, StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work


def _fit(work: "Work") -> None:
    work.modeller.fit(work)


class FittingTask(StageTask):
    """Fit the segments of one update after the other; parameters as of `StageTask`."""

    def __init__(
        self,
        worker: Executor,
        queue: ItemQueue,
        activity: Activity,
        deliver: Callable[[Item], None],
    ) -> None:
        super().__init__((_fit,), worker, queue, activity, deliver)
