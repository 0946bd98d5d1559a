"""The modelling process, which shares no interpreter lock with the leader's ticks.

The leader writes pickled calls of `Stages` to the standard input of this child process and reads
an answer to each from its standard output. The process ends when its input is closed, so that no
leader leaves one behind.
"""

import gc
import os
import pickle
import signal
import subprocess
import sys
from asyncio import wrap_future
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from threading import Event
from typing import IO, TYPE_CHECKING, Any, Self

from mmt.core.errors import MmtError
from mmt.core.extras import require
from mmt.core.running.process import ProcessMeter, lower_priority, release_compiler
from mmt.core.running.programs import handle_end_signals, python_command
from mmt.texture.modeller_factory import ModellerFactory

if TYPE_CHECKING:
    from mmt.core.running.process import ProcessCost
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
        self.numerics = ModellerFactory(settings, period_s).numerics
        """Names of the modules that the process imports before it models."""
        self._waiting: list[tuple[object, ...]] = []
        self._process: subprocess.Popen[bytes] | None = None
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
            self._process = subprocess.Popen(  # noqa: S603 - our own module
                python_command("-m", __name__, *self.numerics),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=sys.platform != "win32",
            )

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
            with suppress(OSError), self._process:  # unsent data cannot be flushed
                pass

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
        assert process.stdin is not None  # noqa: S101 - it was asked for
        assert process.stdout is not None  # noqa: S101 - it was asked for
        try:
            _write(process.stdin, message)
            fault, answer = pickle.load(process.stdout)  # noqa: S301 - from ours
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            code = process.wait()
            how = f"was ended by signal {-code}" if code < 0 else f"has ended with code {code}"
            raise MmtError(f"the process that models {how}") from error
        if fault is not None:
            raise MmtError(f"the process that models has failed: {fault}")
        return answer


def _write(stream: IO[bytes], message: object) -> None:
    pickle.dump(message, stream, pickle.HIGHEST_PROTOCOL)
    stream.flush()


def main() -> None:
    """Run the process until its input is closed."""
    handle_end_signals(signal.SIG_IGN)  # the leader says when it ends
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # printed text must not mix with the answers
    with suppress(EOFError, BrokenPipeError):
        try:
            _answer(answers)
        except (EOFError, BrokenPipeError):
            raise  # the leader has ended
        except Exception as error:
            _write(answers, (f"{type(error).__name__}: {error}", None))
            raise


def _answer(answers: IO[bytes]) -> None:
    from mmt.core.compiled import are_cached, collect_kernels, compile_collected

    kernels = collect_kernels(sys.argv[1:])
    if are_cached(kernels):
        compile_collected(kernels)
    calls = sys.stdin.buffer
    setup = pickle.load(calls)  # noqa: S301 - from the leader
    compile_collected(kernels)  # at the first start the leader has had them compiled meanwhile
    from mmt.leader.modelling.stages import Stages

    stages = Stages(*setup)
    gc.collect()
    gc.freeze()
    release_compiler()
    _write(answers, (None, None))
    lower_priority()  # the leader's ticks come first
    while True:
        name, arguments, named = pickle.load(calls)  # noqa: S301 - from the leader
        _write(answers, (None, getattr(stages, name)(*arguments, **named)))


if __name__ == "__main__":
    main()
