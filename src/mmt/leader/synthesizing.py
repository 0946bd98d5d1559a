"""The task that synthesizes: fits in, an immutable model out, from which the tick renders.

The task chooses the fits that the model is made of and triangulates them (Delaunay, or as the
scene says). The tick renders from the newest model that was put to use: a snapshot that is
replaced by one assignment and never changed.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from mmt.leader.stage import Activity, Item, ItemQueue, StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work


def _choose(work: "Work") -> None:
    work.modeller.choose(work)


def _build(work: "Work") -> None:
    work.modeller.build(work)


class SynthesizingTask(StageTask):
    """Build the model of one update after the other; parameters as of `StageTask`."""

    def __init__(
        self,
        worker: Executor,
        queue: ItemQueue,
        activity: Activity,
        deliver: Callable[[Item], None],
    ) -> None:
        super().__init__((_choose, _build), worker, queue, activity, deliver)
