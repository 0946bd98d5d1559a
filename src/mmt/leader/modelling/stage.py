"""Fitting, synthesizing and completing: the task, its bounded queue, and its figures."""

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final, Literal

from mmt.core.running.ticking import TimeHistogram

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.leader.modelling.process import ModellingProcess
    from mmt.leader.run_log import RunLog

_S: Final = 1e9


class Figures:
    """How long a task's queue is, how long each item took, and how many were dropped."""

    def __init__(self, queue_length: Callable[[], int]) -> None:
        self._queue_length = queue_length
        self._times = TimeHistogram()
        self.queue_most = 0
        self.longest_s = 0.0
        self.drops = 0

    @property
    def items(self) -> int:
        """How many items were worked on."""
        return self._times.count

    @property
    def queue_now(self) -> int:
        """How many items wait."""
        return self._queue_length()

    @property
    def median_s(self) -> float:
        """The median time of an item, 0 before the first."""
        return (self._times.quantile_ns(0.5) or 0.0) / _S

    def record_length(self) -> None:
        """Note the length of the queue after something was put into it."""
        self.queue_most = max(self.queue_most, self._queue_length())

    def add(self, seconds: float) -> None:
        """Note how long an item took."""
        self._times.add(round(seconds * _S))
        self.longest_s = max(self.longest_s, seconds)

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as a dictionary."""
        return {
            "items": self.items,
            "queue": self.queue_now,
            "queue_most": self.queue_most,
            "median_ms": round(1e3 * self.median_s, 3) if self.items else None,
            "longest_ms": round(1e3 * self.longest_s, 3) if self.items else None,
            "drops": self.drops,
        }


@dataclass
class Item:
    """Work on its way from task to task.

    Attributes
    ----------
    number
        Number of the work in the process.
    seconds
        Time that the work has taken so far.
    answer
        Result of the last stage.
    """

    number: int
    seconds: float = 0.0
    answer: Any = None


class InFlight:
    """Counts items between two places of the pipeline, so that a task can wait for none."""

    def __init__(self) -> None:
        self._count = 0
        self._none = asyncio.Event()
        self._none.set()

    def __bool__(self) -> bool:
        return self._count > 0

    def add(self) -> None:
        """Count one more item."""
        self._count += 1
        self._none.clear()

    def remove(self) -> None:
        """Count one item less."""
        self._count -= 1
        if self._count <= 0:
            self.clear()

    def clear(self) -> None:
        """Count no items: all were discarded."""
        self._count = 0
        self._none.set()

    async def wait_until_empty(self) -> None:
        """Wait until there is none."""
        await self._none.wait()


class StageTask:
    """Takes work from its bounded queue, lets the process work on each item, and delivers it.

    A full queue drops the oldest item; the next one takes over its removals from the model and its
    observations of the stream. Its new segments are lost only if they were not fitted yet: later
    they are among the fits of the next work. If the queue is at least half full, the task cannot
    keep up and takes all items as one update.

    Parameters
    ----------
    stage
        Name of the method of `mmt.leader.modelling.stages.Stages` that works on an item.
    process
        Process that runs the numerics.
    capacity
        Most items that may wait.
    on_absorbed
        Called for each item that a later one has taken over: with the later item, the earlier
        item, and whether the earlier item's new segments count.
    deliver
        Called on the event loop with each item that is done.
    """

    def __init__(
        self,
        stage: Literal["fit", "build", "judge"],
        process: "ModellingProcess",
        capacity: int,
        on_absorbed: Callable[[Item, Item, bool], None],
        deliver: Callable[[Item], None],
    ) -> None:
        self._stage = stage
        self._process = process
        self._capacity = capacity
        self._on_absorbed = on_absorbed
        self._deliver = deliver
        self._generation = 0
        self._filled = asyncio.Event()
        self.items: deque[Item] = deque()
        """Items that wait, the oldest first."""
        self.figures = Figures(lambda: len(self.items))

    def put(self, item: Item) -> None:
        """Queue an item; never blocks."""
        self.items.append(item)
        self._filled.set()
        while len(self.items) > self._capacity:
            oldest = self.items.popleft()
            self._on_absorbed(self.items[0], oldest, self._stage != "fit")
            self.figures.drops += 1
        self.figures.record_length()

    def get(self) -> Item | None:
        """Return the oldest item, or all in one if too many wait; None if none waits."""
        if not self.items:
            self._filled.clear()
            return None
        item = self.items.popleft()
        if len(self.items) >= self._capacity / 2:
            while self.items:
                later = self.items.popleft()
                later.seconds += item.seconds
                self._on_absorbed(later, item, True)
                item = later
        return item

    def clear(self) -> None:
        """Discard the items that wait and the one under way."""
        self._generation += 1
        self.items.clear()

    async def run(self) -> None:
        """Work until cancelled."""
        while True:
            await self._filled.wait()
            item = self.get()
            if item is None:
                continue
            generation, started = self._generation, perf_counter()
            item.answer = await self._process.call(self._stage, item.number)
            seconds = perf_counter() - started
            if generation == self._generation:
                item.seconds += seconds
                self.figures.add(seconds)
                self._deliver(item)


def modelling_metrics(tasks: "dict[str, Figures]", log: "RunLog") -> Iterator["Metric"]:
    """Yield the figures of the model, and of each task that makes it."""
    from mmt.core.output.exposition import counter, gauge, labelled

    times = log.update_times
    yield counter("model_updates", "Updates of the model.", times.count)
    yield counter("model_update_seconds", "Time spent on updates.", times.cumulative([])[1] / _S)
    yield gauge("model_samples", "Samples in the model.", log.update.samples if log.update else 0)
    if log.update is not None:
        yield gauge("model_distance", "Completion distance.", log.update.distance)
        value = log.update.progress.value
        yield gauge("model_completion", "What the completion criterion in use says.", value)
    if log.surfaces is not None:
        yield gauge("surface", "Number of the surface under the tool.", log.surfaces.current)
        yield gauge("surfaces_known", "Surfaces that were told apart.", log.surfaces.known)
    for name, text, figure in (
        ("task_items", "Items that a task of the modelling has worked on.", "items"),
        ("task_dropped_items", "Items that found no room in a task's queue.", "drops"),
        ("task_queue_items", "Items that wait for a task of the modelling.", "queue_now"),
        ("task_queue_most_items", "Most items that have waited for it.", "queue_most"),
        ("task_median_seconds", "Median time that an item has taken.", "median_s"),
        ("task_longest_seconds", "Longest time that an item has taken.", "longest_s"),
    ):
        values = {task: getattr(figures, figure) for task, figures in tasks.items()}
        yield labelled(name, text, "task", values, grows=figure in ("items", "drops"))
    dropped = tasks["segmenting"].drops
    yield counter("modelling_dropped_frames", "Frames that found no room.", dropped)
