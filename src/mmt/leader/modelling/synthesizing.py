"""The task that builds the interpolated model from new fits.

The task chooses the fits that the model is made of and triangulates them (Delaunay, or as the
scene says). The tick renders from the newest model that was put to use: a snapshot that is
replaced by one assignment and never changed.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from mmt.leader.modelling.stage import Activity, Item, ItemQueue, StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work


def _build(work: "Work") -> None:
    work.modeller.build(work)


class SynthesizingTask(StageTask):
    """Build the interpolated model from the fits of one update after the other.

    Parameters as of `StageTask`; the model is a snapshot that rendering gets once it is judged.
    """

    def __init__(
        self,
        worker: Executor,
        queue: ItemQueue,
        activity: Activity,
        deliver: Callable[[Item], None],
    ) -> None:
        super().__init__((_build,), worker, queue, activity, deliver)
