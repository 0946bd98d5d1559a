"""Model the texture beside the rendering: one update a period, in a worker thread.

Frames wait in a bounded queue; a full one drops the oldest and counts it. The worker runs
compiled code that releases the interpreter lock, so that the 1 kHz tick is not delayed.
"""

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from mmt.arrays import RecordArray
from mmt.leader.frame_queue import FrameQueue
from mmt.texture.modelling import ModelUpdate, OnlineModeller
from mmt.texture.settings import ModellingSettings

_LONGEST_QUEUE_S: Final = 10.0


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
    """

    def __init__(
        self,
        settings: ModellingSettings,
        period_s: float,
        on_update: Callable[[ModelUpdate, float], None],
    ) -> None:
        self._settings = settings
        self._period_frames = max(1, round(period_s * settings.rate_hz))
        self._on_update = on_update
        self._modeller = OnlineModeller(settings)
        capacity = max(self._period_frames, round(_LONGEST_QUEUE_S * settings.rate_hz))
        self._queue = FrameQueue(capacity, least_drop=self._period_frames)
        self._due = asyncio.Event()
        self._generation = 0
        self.dropped_frames = 0
        self.working = False
        self.finished = False

    def take(self, frames: RecordArray) -> None:
        """Queue frames; never blocks."""
        if self.finished:
            return
        self.dropped_frames += self._queue.put(frames)
        first = self._queue.first_sequence
        if first is not None and int(frames["sequence"][-1]) - first >= self._period_frames - 1:
            self._due.set()

    def reset(self) -> None:
        """Start a new model; an update that is under way is thrown away."""
        self._generation += 1
        self._modeller = OnlineModeller(self._settings)
        self._clear_queue()
        self.finished = False

    async def run(self) -> None:
        """Update until cancelled; modelling pauses once the stop criterion is met."""
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="modelling") as worker:
            loop = asyncio.get_running_loop()
            while True:
                await self._due.wait()
                frames = self._clear_queue()
                generation, modeller = self._generation, self._modeller
                started = time.perf_counter()
                self.working = True
                try:
                    stages = modeller.stages(frames)
                    update = None
                    while update is None:  # between two stages the tick has the lock to itself
                        update = await loop.run_in_executor(worker, next, stages)
                finally:
                    self.working = False
                if generation != self._generation:
                    continue
                if update.stopped:
                    self.finished = True
                    self._clear_queue()
                self._on_update(update, time.perf_counter() - started)

    def _clear_queue(self) -> RecordArray:
        self._due.clear()
        return self._queue.take_all()
