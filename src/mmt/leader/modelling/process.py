"""The modelling process, which shares no interpreter lock with the leader's ticks.

The leader sends this child process calls of `Stages`, and gets an answer to each.
"""

import gc
import sys
from asyncio import wrap_future
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from threading import Event
from typing import TYPE_CHECKING, Any, Self

from mmt.core.errors import MmtError
from mmt.core.extras import require
from mmt.core.running.child_process import ChildProcess, Parent
from mmt.core.running.process import ProcessCost, ProcessMeter, lower_priority, release_compiler
from mmt.texture.modeller_factory import ModellerFactory

if TYPE_CHECKING:
    from mmt.scene import Scene
    from mmt.texture.settings import ModellingSettings


class ModellingProcess:
    """Start the modelling process, and call `Stages` in it, one call after the other.

    Calls wait for `start`. A thread waits for the answers; the event loop never does.

    Parameters
    ----------
    settings, period_s
        As of `mmt.leader.modelling.stages.Stages`.
    """

    def __init__(self, settings: "ModellingSettings", period_s: float) -> None:
        self._setup = settings, period_s
        self.factory = ModellerFactory(settings, period_s)
        """Describes the modeller in the process."""
        self._waiting: list[tuple[object, ...]] = []
        self._process: ChildProcess | None = None
        self._meter: ProcessMeter | None = None
        self._closed = Event()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="modelling")
        self.started: Future[None] | None = None
        """Done when the process can model; None before `start`."""
        self.busy = 0
        """Number of calls that are awaited."""
        self.cost: ProcessCost | None = None
        """Cost of the process while it modelled; None before `close`."""

    @classmethod
    def from_scene(cls, scene: "Scene") -> Self | None:
        """Return the process for a scene's texture, or None if the scene has none."""
        texture = scene.texture
        if texture is None:
            return None
        settings = texture.settings(scene.session.samples_per_frame)
        return cls(settings, texture.update_period_s)

    def launch(self) -> None:
        """Launch the process, unless launched: it imports its modules, and waits for `start`.

        Raises
        ------
        InputError
            A package that the process needs is not installed.
        """
        if self._process is None:
            for package in ("numba", "scipy"):
                require(package)  # else it would end with a traceback
            self._process = ChildProcess("-m", __name__, *self.factory.numerics)

    def start(self) -> Future[None]:
        """Start to model, launch if necessary; return a future that is done when ready."""
        if self.started is None:
            self.started = self._worker.submit(self._start)
            for call in self._waiting:
                self._worker.submit(self._exchange, call)
        return self.started

    async def call(self, name: str, *arguments: object, **named: object) -> Any:
        """Call a method of `Stages` and return its result.

        Raises
        ------
        MmtError
            The process has ended.
        """
        self.busy += 1
        try:
            return await wrap_future(self._worker.submit(self._exchange, (name, arguments, named)))
        finally:
            self.busy -= 1

    def notify(self, name: str, *arguments: object, **named: object) -> None:
        """Call a method without waiting for it; do nothing if the process is closed."""
        call = name, arguments, named
        if self.started is None:
            self._waiting.append(call)
        elif not self._closed.is_set():
            self._worker.submit(self._exchange, call)

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._closed.set()
        if self._process is not None:
            if self._meter is not None and self._process.poll() is None:
                self.cost = self._meter.read()
            self._process.kill()
        self._worker.shutdown(cancel_futures=True)
        if self._process is not None:
            self._process.close()

    def _start(self) -> None:
        if self._closed.is_set():
            return
        self.launch()
        assert self._process is not None  # noqa: S101 - it was launched
        if self._closed.is_set():
            self._process.kill()
        self._exchange(self._setup)
        self._meter = ProcessMeter(self._process.pid)

    def _exchange(self, message: object) -> Any:
        process = self._process
        assert process is not None  # noqa: S101 - it is started before anything else
        try:
            fault, answer = process.ask(message)
        except EOFError as error:
            code = process.wait()
            how = f"was ended by signal {-code}" if code < 0 else f"has ended with code {code}"
            raise MmtError(f"the process that models {how}") from error
        if fault is not None:
            raise MmtError(f"the process that models has failed: {fault}")
        return answer


def main() -> None:
    """Run the process until the leader has gone."""
    leader = Parent()
    with suppress(EOFError, BrokenPipeError):
        try:
            _answer(leader)
        except (EOFError, BrokenPipeError):
            raise  # the leader has ended
        except Exception as error:
            leader.send((f"{type(error).__name__}: {error}", None))
            raise


def _answer(leader: Parent) -> None:
    from mmt.core.compiled import are_cached, collect_kernels, compile_collected

    kernels = collect_kernels(sys.argv[1:])
    if are_cached(kernels):
        compile_collected(kernels)
    setup = leader.receive()
    compile_collected(kernels)  # at the first start the leader has had them compiled meanwhile
    from mmt.leader.modelling.stages import Stages

    stages = Stages(*setup)
    gc.collect()
    gc.freeze()
    release_compiler()
    leader.send((None, None))
    lower_priority()  # the leader's ticks come first
    for name, arguments, named in leader:
        leader.send((None, getattr(stages, name)(*arguments, **named)))


if __name__ == "__main__":
    main()
