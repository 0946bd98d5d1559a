"""The task that fits: segments in, filters of Burg's method as line spectral frequencies out."""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING

from mmt.leader.stage import Activity, InFlight, Item, ItemQueue, StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work


def _fit(work: "Work") -> None:
    work.modeller.fit(work)


class FittingTask(StageTask):
    """Fit the segments of one update after the other.

    As long as the order of the filters follows the data, an update
    waits until the one before it is judged; so the model is that of an offline pass.

    Parameters
    ----------
    worker, queue, activity
        As `StageTask`.
    behind
        Counts the items from here to the end of the pipeline.
    deliver
        As `StageTask`.
    """

    def __init__(
        self,
        worker: Executor,
        queue: ItemQueue,
        activity: Activity,
        behind: InFlight,
        deliver: Callable[[Item], None],
    ) -> None:
        super().__init__((_fit,), worker, queue, activity, self._handed_on)
        self._behind = behind
        self._hand_on = deliver

    def _handed_on(self, item: Item) -> None:
        self._behind.enter()
        self._hand_on(item)

    async def wait_for_turn(self) -> None:
        """Wait for the verdict on the update before, where the fitting depends on it."""
        while (items := self.queue.items) and self._behind:
            if not items[0].work.modeller.fits_by_verdict:
                return
            await self._behind.until_none()
