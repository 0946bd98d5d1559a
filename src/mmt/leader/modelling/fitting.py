"""The task that fits: segments in, filters of Burg's method as line spectral frequencies out."""

from typing import TYPE_CHECKING

from mmt.leader.modelling.stage import StageTask

if TYPE_CHECKING:
    from mmt.texture.online.work import Work


class FittingTask(StageTask):
    """Fit the segments of one update after the other."""

    def work_on(self, work: "Work") -> None:
        """Fit the new segments."""
        work.modeller.fit(work)
