"""The modelling beside the rendering: four tasks joined by bounded queues.

Frames go to `segmenting`, segments to `fitting`, fits to `synthesizing` and models to
`completing`, which judges each update. One process (`mmt.leader.modelling.process`) does the
numerics of all tasks; it shares no interpreter lock with the ticks. The model is the same to the
bit as that of an offline pass over the same frames. If the process ends, the stream and the
newest model stay as they are.
"""

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError, MmtError
from mmt.leader.modelling.process import ModellingProcess
from mmt.leader.modelling.segmenting import LONGEST_QUEUE_S, SegmentingTask
from mmt.leader.modelling.stage import (
    Figures,
    InFlight,
    Item,
    StageTask,
    modelling_metrics,
)
from mmt.leader.modelling.stages import Models, UpdateResult, received
from mmt.leader.part import Part, Session, Tick
from mmt.texture.online.updates import ModelUpdate, NewSamples, SurfaceStatement

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.texture.model.texture_model import TextureModel

_POLL_S: Final = 0.005
_LAST_UPDATES_S: Final = 1.0


class Modelling(Part):
    """Build the model of the stream, one update per period.

    Parameters
    ----------
    session
        Session of the run.
    process
        Process that runs the numerics; it is started when the parts connect.
    """

    def __init__(self, session: Session, process: ModellingProcess) -> None:
        self._session, self._process, self._factory = session, process, process.factory
        self._last_ns = 0
        self.deliver: Callable[[ModelUpdate, float], None] = lambda *_: None
        """Called on the event loop with each update and the seconds that the tasks worked on it."""
        self._on_samples: Callable[[NewSamples], None] = lambda _: None
        self._behind_segmenting = InFlight()
        self._make_tasks()
        self._models: Models = {}
        self._first_sample, self._newest_sample = 0, -1  # of the session
        self.fault: str | None = None
        """Why modelling has ended before the session, or None."""
        self.finished = False
        self.frozen = False
        """Whether a person has frozen the model, so that no frames are modelled."""

    def return_samples(self, on_samples: Callable[[NewSamples], None]) -> None:
        """Set the function to call with the samples of each judged update, from the first on."""
        self._on_samples = on_samples
        self._process.notify("return_samples")

    def connect(self) -> None:
        """Start the process, if necessary, and wait until it can model.

        Raises
        ------
        MmtError
            The process cannot model.
        """
        self._process.start().result()

    def _make_tasks(self) -> None:
        process, session, frames = self._process, self._session, self._factory.frames_at_once
        capacity = max(2, round(LONGEST_QUEUE_S * session.rate_hz / frames))
        queue = process, capacity, self._merge
        self.completing = StageTask("judge", *queue, self._judged)
        self.synthesizing = StageTask("build", *queue, self.completing.put)
        self.fitting = StageTask("fit", *queue, self.synthesizing.put)
        self.segmenting = SegmentingTask(
            frames,
            session.rate_hz,
            session.scene.keep_frames(),
            self._factory.sequential,
            process,
            self._behind_segmenting,
            self.fitting.put,
        )
        self._tasks: dict[str, SegmentingTask | StageTask] = {
            "segmenting": self.segmenting,
            "fitting": self.fitting,
            "synthesizing": self.synthesizing,
            "completing": self.completing,
        }

    @property
    def working(self) -> bool:
        """Whether one of the tasks is at work."""
        return self._process.busy > 0

    @property
    def figures(self) -> dict[str, Figures]:
        """The figures of each task, by its name."""
        return {name: task.figures for name, task in self._tasks.items()}

    def on_frames(self, frames: RecordArray, _arrival_ns: int = 0) -> None:
        """Queue frames (n,); never blocks."""
        if self._newest_sample < 0:
            self._first_sample = int(frames["sequence"][0])
        self._newest_sample = int(frames["sequence"][-1])
        if self._grows:
            self.segmenting.put(frames)

    def on_backfill(self, frames: RecordArray, _arrival_ns: int = 0) -> None:
        """Insert late frames (n,) in the order of their numbers; never blocks."""
        if self._grows:
            self.segmenting.insert(frames)

    def on_settled(self) -> None:
        """Go on: some missing frames have come, or will not come."""
        self.segmenting.wake()

    def freeze(self, frozen: bool) -> None:
        """Freeze the model, or let it grow again; an update under way still counts."""
        self.frozen = frozen
        self.segmenting.clear(self._newest_sample)

    def state_surface(self, surface: int) -> None:
        """Set the surface under the tool from the next frame on, as stated by a person.

        Raises
        ------
        InputError
            Surfaces are not told apart.
        """
        if not self._factory.sequential:
            raise InputError("this scene has one surface: it has no [texture.surfaces]")
        self._process.notify("state_surface", SurfaceStatement(self._newest_sample + 1, surface))

    def reset(self) -> None:
        """Start a new model; discard updates under way."""
        self._clear()
        self._models = {}
        self.segmenting.first = None
        self.finished = self.frozen = False

    @property
    def since_s(self) -> float:
        """Session time of the model's first frame."""
        first = self.segmenting.first
        return 0.0 if first is None else (first - self._first_sample) / self._session.rate_hz

    async def finish(self, timeout_s: float = _LAST_UPDATES_S) -> None:
        """Wait until all whole periods in the queue are modelled, for at most `timeout_s`."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.working or self._behind_segmenting or self._frames_due:
                    await asyncio.sleep(_POLL_S)

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return the coroutines of the four tasks, by name."""
        return {name: self._until_fault(task.run()) for name, task in self._tasks.items()}

    def close(self) -> None:
        """End the process."""
        self._process.close()

    def tick(self, tick: Tick) -> None:
        """Note how late the ticks are, while a task is at work and otherwise."""
        if self._last_ns:
            late_ns = tick.now_ns - self._last_ns - self._session.period_ns
            log = self._session.log
            late = log.late_while_modelling if self.working else log.late_otherwise
            late.add(late_ns)
        self._last_ns = tick.now_ns

    def faults(self) -> list[str]:
        """Return why modelling has ended, if it has."""
        return [] if self.fault is None else [self.fault]

    def status(self) -> dict[str, Any]:
        """Return the state of the model."""
        update = self._session.log.update
        if update is None:
            return {}
        return {
            "samples": update.samples,
            "distance": update.distance,
            "completion": str(update.progress),
        }

    def summary(self, duration_s: float) -> dict[str, Any]:
        """Return the model, how complete it is, and the figures of each task."""
        log = self._session.log
        update, times, cost = log.update, log.update_times, self._process.cost
        table = {
            "samples": update.samples if update else 0,
            "order": update.order if update else None,
            "distance": round(update.distance, 3) if update else None,
            "completion": update.progress.as_dict() if update else None,
            "faults": update.faults.as_dict() if update else None,
            "start_s": log.start_s,
            "stop_s": log.stop_s,
            **({"surfaces": log.surfaces.as_dict(duration_s)} if log.surfaces is not None else {}),
            "updates": times.count,
            "update_median_ms": round(times.quantile_ms(0.5) or 0.0, 2) if times.count else None,
            "update_longest_ms": round(times.quantile_ms(1.0) or 0.0, 2) if times.count else None,
            "dropped_frames": self.segmenting.figures.drops,
            "late_frames": self.segmenting.late_frames,
            "fault": self.fault,
            "process": None if cost is None else cost.as_dict(),
            "tasks": {name: figures.as_dict() for name, figures in self.figures.items()},
        }
        ticks: dict[str, Any] = {}
        for name, late in (
            ("while_modelling", log.late_while_modelling),
            ("otherwise", log.late_otherwise),
        ):
            ticks[f"late_{name}_p99_ms"] = late.quantile_ms(0.99)
            (soon,), _ = late.cumulative([1_000_000])
            ticks[f"late_{name}_share_1ms"] = 1.0 - soon / late.count if late.count else None
        return {"texture": table, "ticks": ticks}

    def metrics(self) -> "Iterable[Metric]":
        """Return the model's figures, and those of each task."""
        yield from modelling_metrics(self.figures, self._session.log)

    def models(self) -> "dict[int, TextureModel]":
        """Return the model of each surface by number; empty if surfaces are not told apart."""
        return {
            n: model for n, model in self._models.items() if n is not None and model is not None
        }

    async def _until_fault(self, task: Coroutine[Any, Any, None]) -> None:
        """Run a task; if the process ends, report it once and stop modelling."""
        try:
            await task
        except MmtError as error:
            if self.fault is None:
                self.fault = f"modelling has ended: {error}"
                self.segmenting.clear(self._newest_sample)
                self._behind_segmenting.clear()
                self._session.journal.event(self.fault)

    def _merge(self, later: Item, earlier: Item, segments: bool) -> None:
        self._process.notify("merge", later.number, earlier.number, segments=segments)
        self._behind_segmenting.remove()

    @property
    def _grows(self) -> bool:
        return not (self.finished or self.frozen or self.fault)

    @property
    def _frames_due(self) -> bool:
        return self.segmenting.due and not self.finished and self.fault is None

    def _clear(self) -> None:
        """Discard everything that waits or is under way."""
        for task in (self.fitting, self.synthesizing, self.completing):
            task.clear()
        self.segmenting.discard_work()
        self.segmenting.clear(self._newest_sample)
        self._process.notify("begin")
        self._behind_segmenting.clear()

    def _judged(self, item: Item) -> None:
        """Report an update; after the last one discard all later work."""
        judged: UpdateResult = item.answer
        if judged.samples is not None:
            self._on_samples(judged.samples)
        if judged.update is not None:
            update = received(judged.update, self._models)
            if judged.kept is not None:
                self._models = {n: m for n, m in self._models.items() if n in judged.kept}
            if self._factory.is_finished(update):
                self.finished = True
                self._clear()
            self.deliver(update, item.seconds)
        self._behind_segmenting.remove()
