"""The modelling beside the rendering: four tasks joined by bounded queues.

Frames go to `segmenting`, segments to `fitting`, fits to `synthesizing` and models to
`completing`, which says what each update has come to. Each task hands its numerics to one worker
thread, step by step: mostly compiled code that releases the interpreter lock. Short calls that
release it often still delay some ticks of 1 kHz. The model is the same to the bit as that of an
offline pass over the same frames.
"""

import asyncio
import statistics
from collections.abc import Callable, Coroutine, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.kernel_cache import LONGEST_COMPILATION_S, Compilation
from mmt.leader.modelling.completing import CompletingTask
from mmt.leader.modelling.fitting import FittingTask
from mmt.leader.modelling.segmenting import LONGEST_QUEUE_S, SegmentingTask
from mmt.leader.modelling.stage import Activity, Figures, InFlight, Item, ItemQueue
from mmt.leader.modelling.synthesizing import SynthesizingTask
from mmt.leader.part import Part, Session, Tick
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.online.work import ModelUpdate, Work
from mmt.texture.settings import ModellingSettings
from mmt.texture.surfaces.factory import ModellerFactory

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.texture.model.texture_model import TextureModel

_POLL_S: Final = 0.005
_LAST_UPDATES_S: Final = 1.0


class Modelling(Part):
    """Build the model of the stream, an update a period.

    Parameters
    ----------
    settings
        Settings of the modelling.
    period_s
        Time between updates.
    on_update
        Called on the event loop after each update, with it and the seconds that the tasks have
        worked on it.
    keep_frames
        How many frames the follower can send again: this many more may wait.
    compilation
        Compiles the kernels, and frames wait for it; None where they are compiled.
    """

    def __init__(
        self,
        settings: ModellingSettings,
        period_s: float,
        on_update: Callable[[ModelUpdate, float], None],
        keep_frames: int = 0,
        compilation: Compilation | None = None,
    ) -> None:
        self._session: Session | None = None
        self._last_ns = 0
        self._factory = ModellerFactory(settings, period_s)
        self._on_update = on_update
        self.on_work: Callable[[Work], None] = lambda _: None  # called with all that is judged
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="modelling")
        self._compilation, self._compiled = compilation, None
        if compilation is not None:
            self._compiled = self._worker.submit(compilation.finish)
            keep_frames += round(LONGEST_COMPILATION_S * settings.rate_hz)
        self._activity = Activity()
        self._behind_segmenting = InFlight()
        frames = self._factory.frames_at_once
        capacity = max(2, round(LONGEST_QUEUE_S * settings.rate_hz / frames))
        self._make_tasks(settings.rate_hz, keep_frames, capacity)
        self._modeller = self._factory.make()
        self._newest_sample = -1
        self.segmenting.start_model(self._modeller)
        self.finished = False
        self.frozen = False
        """Whether frames are not modelled for now, because a person wants it."""

    @classmethod
    def build(
        cls, session: Session, on_update: Callable[[ModelUpdate, float], None]
    ) -> "Modelling | None":
        """Return the modelling of the scene's texture."""
        scene = session.scene
        if scene.texture is None:
            return None
        made = cls(
            scene.texture.settings(session.rate_hz),
            scene.texture.update_period_s,
            on_update,
            keep_frames=scene.keep_frames(),
            compilation=session.compilation,
        )
        made._session = session
        if scene.texture.surfaces is not None and scene.replay is not None:
            from mmt.leader.surface_log import replayed_words

            made._modeller = made._factory.make(replayed_words(scene.replay))
            made.segmenting.start_model(made._modeller)
        return made

    def _make_tasks(self, rate_hz: float, keep_frames: int, capacity: int) -> None:
        worker, activity = self._worker, self._activity
        fitting_queue = ItemQueue(capacity, True, self._behind_segmenting.leave)
        queues = [ItemQueue(capacity, False, self._behind_segmenting.leave) for _ in range(2)]
        self.completing = CompletingTask(worker, queues[1], activity, self._judged)
        self.synthesizing = SynthesizingTask(worker, queues[0], activity, self.completing.put)
        self.fitting = FittingTask(worker, fitting_queue, activity, self.synthesizing.put)
        self.segmenting = SegmentingTask(
            self._factory.frames_at_once,
            rate_hz,
            keep_frames,
            worker,
            activity,
            self._behind_segmenting,
            self.fitting.put,
        )

    @property
    def working(self) -> bool:
        """Whether one of the tasks is at work."""
        return self._activity.busy > 0

    @property
    def figures(self) -> dict[str, Figures]:
        """The figures of each task, by its name."""
        return {
            "segmenting": self.segmenting.figures,
            "fitting": self.fitting.figures,
            "synthesizing": self.synthesizing.figures,
            "completing": self.completing.figures,
        }

    @property
    def dropped_frames(self) -> int:
        """Frames that found no room."""
        return self.segmenting.figures.drops

    @property
    def late_frames(self) -> int:
        """Frames that were filled in after an update had gone on without them."""
        return self.segmenting.late_frames

    def wait_for_missing(self, first_missing: Callable[[], int | None]) -> None:
        """Let updates wait for frames from this number on, None where none may be filled in."""
        self.segmenting.first_missing = first_missing

    def on_frames(self, frames: RecordArray, arrival_ns: int = 0) -> None:
        """Queue frames (n,); never blocks."""
        _ = arrival_ns
        self._newest_sample = int(frames["sequence"][-1])
        if not (self.finished or self.frozen):
            self.segmenting.put(frames)

    def on_backfill(self, frames: RecordArray, arrival_ns: int = 0) -> None:
        """Queue frames (n,) that came late at their place; never blocks."""
        _ = arrival_ns
        if not (self.finished or self.frozen):
            self.segmenting.insert(frames)

    def on_settled(self) -> None:
        """Go on if that which was missing has come, or will not come."""
        self.segmenting.look_again()

    def freeze(self, frozen: bool) -> None:
        """Leave the model as it is, or let it grow again; an update under way still counts."""
        self.frozen = frozen
        if frozen:
            self.segmenting.clear()

    def say_surface(self, surface: int) -> None:
        """Take a person's word that the tool is on this surface from the next frame on.

        Raises
        ------
        InputError
            Surfaces are not told apart.
        """
        if isinstance(self._modeller, OnlineModeller):
            raise InputError("this scene has one surface: it has no [texture.surfaces]")
        from mmt.texture.surfaces import SaidSurface

        self._modeller.say(SaidSurface(self._newest_sample + 1, surface))

    def reset(self) -> None:
        """Start a new model; updates that are under way are thrown away."""
        self._modeller = self._factory.make()
        self._clear()
        self.finished = self.frozen = False

    async def finish(self, timeout_s: float = _LAST_UPDATES_S) -> None:
        """Wait until whole periods that wait are modelled, for at most this long."""
        if self._compiled is not None and not self._compiled.done() and self._session is not None:
            self._session.journal.say("modelling had not begun; mmt model build does it later")
            return
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.working or self._behind_segmenting or self._frames_due:
                    await asyncio.sleep(_POLL_S)

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return what the event loop is to run, by name."""
        return {
            "segmenting": self._segment(),
            "fitting": self.fitting.run(),
            "synthesizing": self.synthesizing.run(),
            "completing": self.completing.run(),
        }

    def close(self) -> None:
        """End the worker, after the step that it is at."""
        if self._compilation is not None:
            self._compilation.stop()
        self._worker.shutdown(cancel_futures=True)

    def tick(self, tick: Tick) -> None:
        """Note how late the ticks are, while a task is at work and otherwise."""
        if self._last_ns and self._session is not None:
            late_ns = tick.now_ns - self._last_ns - self._session.period_ns
            log = self._session.log
            late = log.late_while_modelling if self._activity.busy else log.late_otherwise
            late.add(late_ns)
        self._last_ns = tick.now_ns

    def status(self) -> dict[str, Any]:
        """Return how far the model is."""
        update = self._session.log.update if self._session is not None else None
        if update is None:
            return {}
        return {
            "samples": update.samples,
            "distance": update.distance,
            "completion": str(update.progress),
        }

    def summary(self, duration_s: float) -> dict[str, Any]:
        """Return the model, how complete it is, and the figures of each task."""
        if self._session is None:
            return {}
        log = self._session.log
        update, seconds = log.update, log.update_seconds
        table = {
            "samples": update.samples if update else 0,
            "order": update.order if update else None,
            "distance": round(update.distance, 3) if update else None,
            "completion": update.progress.as_dict() if update else None,
            "faults": update.faults.as_dict() if update else None,
            "start_s": log.start_s,
            "stop_s": log.stop_s,
            **({"surfaces": log.surfaces.as_dict(duration_s)} if log.surfaces is not None else {}),
            "updates": len(seconds),
            "update_median_ms": round(1e3 * statistics.median(seconds), 2) if seconds else None,
            "update_longest_ms": round(1e3 * max(seconds), 2) if seconds else None,
            "dropped_frames": self.dropped_frames,
            "late_frames": self.late_frames,
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
        if self._session is not None:
            from mmt.leader.modelling.metrics import modelling_metrics

            yield from modelling_metrics(self.figures, self.dropped_frames, self._session.log)

    def models(self) -> "dict[int, TextureModel]":
        """Return the model of each surface by number; none where they are not told apart."""
        return {} if isinstance(self._modeller, OnlineModeller) else self._modeller.models()

    async def _segment(self) -> None:
        """Begin when the kernels are compiled; all other tasks wait for this one's work."""
        if self._compiled is not None:
            await asyncio.wrap_future(self._compiled)
            self.segmenting.catching_up = True
            if self._session is not None:
                waiting = self.segmenting.figures.queue_now
                self._session.journal.event(f"modelling begins: {waiting} frames have waited")
        await self.segmenting.run()

    @property
    def _frames_due(self) -> bool:
        return self.segmenting.due and not self.finished

    def _clear(self) -> None:
        """Throw away everything that waits or is under way."""
        for task in (self.fitting, self.synthesizing, self.completing):
            task.clear()
        self.segmenting.start_model(self._modeller)
        self._behind_segmenting.clear()

    def _judged(self, item: Item) -> None:
        """Tell of an update; after the last one throw away what came behind it."""
        self.on_work(item.work)
        update = item.work.update
        if item.work.announced and update is not None:
            if self._factory.done(update):
                self.finished = True
                self._clear()
            self._on_update(update, item.seconds)
        self._behind_segmenting.leave()
