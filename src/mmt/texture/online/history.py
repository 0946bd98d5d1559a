"""Build a session's model as the live leader does, and keep every state that it had."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.online.modeller import ModelUpdate, OnlineModeller
from mmt.texture.segmentation.bottom_up import CELL
from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import ModellingSettings


@dataclass(frozen=True)
class ModelHistory:
    """Every update of one pass over a session.

    ``finished`` holds the segments of the finished model: that at the stop criterion, or at
    the end where it was never met. ``start_s`` and ``stop_s`` are the session times at which
    the criteria were met, None where they were not.
    """

    updates: tuple[ModelUpdate, ...]
    finished: tuple[Segment, ...]
    start_s: float | None
    stop_s: float | None

    def number(self, time_s: float) -> int:
        """Return the number of the last update up to a session time, -1 before the first."""
        times = [update.time_s for update in self.updates]
        return int(np.searchsorted(times, time_s, side="right")) - 1

    def model(self, number: int) -> TextureModel | None:
        """Return the model after an update by its number, None before the first."""
        return self.updates[number].model if number >= 0 else None


def update_blocks(frames: RecordArray, period_frames: int) -> Iterator[RecordArray]:
    """Cut a session into the blocks that a live leader hands to its modelling.

    A block is full when its newest sequence number is a period ahead of its first one; what
    is left at the end comes as a last, shorter block.
    """
    newest = np.maximum.accumulate(frames["sequence"].astype(np.int64))
    start = 0
    while start < len(frames):
        due = int(frames["sequence"][start]) + period_frames - 1
        stop = int(np.searchsorted(newest, due)) + 1
        stop = max(start + 1, min(stop, len(frames)))
        yield frames[start:stop]
        start = stop


def trials(sessions: Sequence[RecordArray]) -> list[RecordArray]:
    """Return the frames of several sessions as blocks of one, a block for each.

    They are numbered on, with frames left out in between: there filters start anew, and no
    segment reaches from one session into the next. Each begins on the segmentation's grid, so
    that it gives the same segments whatever comes before it.
    """
    blocks, following = [], 0
    for frames in sessions:
        block = frames.copy()
        numbers = frames["sequence"].astype(np.int64)
        block["sequence"] = numbers - int(numbers.min()) + following
        following = (int(block["sequence"].max()) + 1 + CELL) // CELL * CELL
        blocks.append(block)
    return blocks


def build(
    blocks: Sequence[RecordArray],
    settings: ModellingSettings,
    accept: Callable[[Segment], bool] | None = None,
) -> ModelHistory:
    """Feed blocks to a modeller, one update each, on to the end of the session.

    Unlike the live leader, and like paper A's Table I, it does not end at the stop criterion.

    Parameters
    ----------
    blocks
        Of frames, at least one.
    settings
        Of the modelling.
    accept
        Which segments may enter the model; None accepts all.
    """
    modeller = OnlineModeller(settings, accept)
    updates: list[ModelUpdate] = []
    finished: tuple[Segment, ...] = ()
    for block in blocks:
        open_before = not modeller.completion.stopped
        updates.append(modeller.update(block))
        if open_before:
            finished = tuple(fit.segment for fit in modeller.fits.values())
    return ModelHistory(
        updates=tuple(updates),
        finished=finished,
        start_s=modeller.completion.start_s,
        stop_s=modeller.completion.stop_s,
    )
