"""Model the texture beside the rendering: one update a period, in a worker thread.

Frames wait in a bounded queue; a full one drops the oldest and counts it. An update takes the
frames of one period, which the numbers of the frames delimit and not the moment at which they
came: so the model is the same whether frames come in time or are filled in later. An update
whose frames may still be filled in waits for them. The worker runs compiled code that releases
the interpreter lock, so that the 1 kHz tick is not delayed.
"""

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from mmt.core.arrays import RecordArray
from mmt.leader.frame_queue import FrameQueue
from mmt.texture.online.modeller import ModelUpdate, OnlineModeller
from mmt.texture.online.modellers import Modellers
from mmt.texture.settings import ModellingSettings

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel

_LONGEST_QUEUE_S: Final = 10.0
_POLL_S: Final = 0.005
_NOT_DUE: Final = "not due"
"""Ends the stages of a look at the stream after which no model is updated."""


class ModellingTask:
    """Collect frames and update the model once a period.

    Parameters
    ----------
    settings
        Of the modelling.
    period_s
        Time between updates.
    on_update
        Called on the event loop after each update, with it and the seconds it took.
    keep_frames
        How many frames the follower can send again: so many more may wait.
    """

    def __init__(
        self,
        settings: ModellingSettings,
        period_s: float,
        on_update: Callable[[ModelUpdate, float], None],
        keep_frames: int = 0,
    ) -> None:
        self._modellers = Modellers(settings, period_s)
        self._period_frames = self._modellers.frames_at_once
        self._on_update = on_update
        self._modeller = self._modellers.make()
        capacity = max(self._period_frames, round(_LONGEST_QUEUE_S * settings.rate_hz))
        capacity += keep_frames
        self._overloaded_frames = capacity - round(_LONGEST_QUEUE_S / 2 * settings.rate_hz)
        self._queue = FrameQueue(capacity, least_drop=self._period_frames)
        self._due = asyncio.Event()
        self._generation = 0
        self._newest = -1  # that an update has taken
        self.first_missing: Callable[[], int | None] = lambda: None
        """Gives the least number that may still be filled in, None where none may."""
        self.dropped_frames = 0
        self.late_frames = 0
        """Frames that were filled in after an update had gone on without them."""
        self.working = False
        self.finished = False
        self.frozen = False
        """Whether frames are not modelled for now, because a person wants it."""

    def take(self, frames: RecordArray) -> None:
        """Queue frames; never blocks."""
        if self.finished or self.frozen:
            return
        self.dropped_frames += self._queue.put(frames)
        first = self._queue.first_sequence
        if first is not None and int(frames["sequence"][-1]) - first >= self._period_frames - 1:
            self._due.set()

    def fill(self, frames: RecordArray) -> None:
        """Queue frames that came late at their place; never blocks."""
        if self.finished or self.frozen:
            return
        early = frames[frames["sequence"] > self._newest]
        self.late_frames += len(frames) - len(early)
        self.dropped_frames += self._queue.insert(early)

    def look_again(self) -> None:
        """Go on if that which was missing has come, or will not come."""
        self._due.set()

    def freeze(self, frozen: bool) -> None:
        """Leave the model as it is, or let it grow again; an update under way still counts."""
        self.frozen = frozen
        if frozen:
            self._queue.take_all()

    def reset(self) -> None:
        """Start a new model; an update that is under way is thrown away."""
        self._generation += 1
        self._modeller = self._modellers.make()
        self._queue.take_all()
        self.finished = self.frozen = False

    async def finish(self, timeout_s: float) -> None:
        """Wait until whole periods that wait are modelled, for at most this long."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.working or (self._due.is_set() and not self.finished):
                    await asyncio.sleep(_POLL_S)

    async def run(self) -> None:
        """Update until cancelled; modelling pauses once the stop criterion is met."""
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="modelling") as worker:
            loop = asyncio.get_running_loop()
            while True:
                frames = self._next_period()
                if frames is None:
                    self._due.clear()
                    await self._due.wait()
                    continue
                generation, modeller = self._generation, self._modeller
                started = time.perf_counter()
                self.working = True
                try:
                    stages = modeller.stages(frames)
                    update: ModelUpdate | str | None = None
                    while update is None:  # between two stages the tick has the lock to itself
                        update = await loop.run_in_executor(worker, next, stages, _NOT_DUE)
                finally:
                    self.working = False
                if generation != self._generation or isinstance(update, str):
                    continue
                if self._modellers.done(update):
                    self.finished = True
                    self._queue.take_all()
                self._on_update(update, time.perf_counter() - started)

    def models(self) -> "dict[int, TextureModel]":
        """Return the model of each surface by number; none where they are not told apart."""
        return {} if isinstance(self._modeller, OnlineModeller) else self._modeller.models()

    def _next_period(self) -> RecordArray | None:
        """Return the frames of the next update, None where it is not due."""
        if len(self._queue) > self._overloaded_frames:  # updates cannot keep up: make fewer
            frames: RecordArray | None = self._queue.take_all()
        else:
            frames = self._queue.take_period(self._period_frames, self.first_missing())
        if frames is not None:
            self._newest = int(frames["sequence"][-1])
        return frames
