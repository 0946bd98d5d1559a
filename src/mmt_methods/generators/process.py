"""Another method's generator in two processes: one fits it, the other renders from it.

Each is ``python -m mmt_methods.generators.process ROLE DESCRIPTOR DESCRIPTOR``, with a connection
to the leader and one to the other process. The renderer gets a copy (pickle) of each generator that
was fitted, so that a long fit delays no block, whatever its code does. The leader imports none of
that code. Both processes end with the leader.
"""

import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from time import perf_counter, perf_counter_ns, sleep
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import MmtError
from mmt.core.running.process import SWITCH_INTERVAL_S
from mmt.core.running.programs import handle_end_signals
from mmt.leader.output.renderer import ModelCrossfade
from mmt_methods.generators.guarded import GeneratorFault, GuardedGenerator, told_as_fault
from mmt_methods.generators.registry import load
from mmt_methods.generators.vibration import RenderedBlock

FIT: Final = "fit"
RENDER: Final = "render"

RESET: Final = "reset"
"""Sent by the leader to the process that fits, instead of samples, to start over."""

_NICENESS: Final = 10
"""Low priority: fits use the processor time that is left over."""

_GRACE_S: Final = 2.0
"""Time by which a process outlives the other, so that the leader sees which ended first."""


class _Slot:
    """A generator used like a synthesizer; each reset takes another seed."""

    directed = True

    def __init__(self, seeds: Iterator[int]) -> None:
        self.model: GuardedGenerator | None = None
        self.clipped = 0
        self._seeds = seeds

    def reset(self) -> None:
        if self.model is not None:
            self.model.reset(next(self._seeds))

    def render(self, *motion: FloatArray) -> FloatArray:
        x_mm_s, y_mm_s, force_n = motion
        model = self.model
        if model is None:
            return np.zeros(len(force_n))
        before = model.clipped
        inputs = motion if model.directed else (np.hypot(x_mm_s, y_mm_s), force_n)
        output = model.render(*inputs)
        self.clipped += model.clipped - before
        return output


def fit(leader: Connection, renderer: Connection) -> None:
    """Fit the generator, to all waiting samples at once, and send the renderer a copy."""
    from mmt_methods.generators.building import GeneratorModeller

    setup = leader.recv()
    if hasattr(os, "nice"):
        os.nice(_NICENESS)
    name, builder = setup["name"], load(setup["name"])
    leader.send("ready")
    news: SimpleQueue[Any] = SimpleQueue()
    _read(leader, news.put)

    def begun() -> GeneratorModeller:
        return GeneratorModeller(name, builder, setup["settings"])

    epoch, modeller, copy = 0, begun(), None
    while True:
        waiting = [news.get()]
        while not news.empty():
            waiting.append(news.get())
        taken = len(waiting) - waiting.count(RESET)
        while RESET in waiting:
            del waiting[: waiting.index(RESET) + 1]
            epoch, modeller, copy = epoch + 1, begun(), None
            renderer.send((epoch, None))
        started, seconds = perf_counter(), 0.0
        if waiting:
            last, made = copy, modeller.add(waiting)
            with told_as_fault(name, "copying it to the process that renders (pickle)"):
                copy = None if made is None else pickle.dumps(made.generator)
            if copy != last:
                renderer.send((epoch, copy))
            seconds = perf_counter() - started
        leader.send((seconds, modeller.segments, taken))


def render(leader: Connection, fitter: Connection) -> None:
    """Render block by block from the newest copy, with a fade from one copy to the next."""
    setup = leader.recv()
    sys.setswitchinterval(SWITCH_INTERVAL_S)  # another thread reads the copies
    name, limit_m_s2 = setup["name"], setup["limit_m_s2"]
    load(name)
    seeds = count(setup["seed"])
    slots = _Slot(seeds), _Slot(seeds)
    fade = ModelCrossfade(*slots, crossfade_samples=setup["crossfade_samples"])
    made: SimpleQueue[tuple[int, GuardedGenerator | GeneratorFault | None]] = SimpleQueue()
    _read(fitter, lambda item: made.put((item[0], _restored(name, item[1], limit_m_s2))))
    leader.send("ready")
    epoch = build = 0
    while True:
        number, motion = leader.recv()
        while not made.empty():
            epoch, generator = made.get()
            if isinstance(generator, GeneratorFault):
                raise generator
            build = 0 if generator is None else build + 1
            fade.cross_to(generator)
        started_ns = perf_counter_ns()
        output = fade.render(*np.frombuffer(motion).reshape(3, -1))
        elapsed_ns = perf_counter_ns() - started_ns
        clipped = sum(each.clipped for each in slots)
        leader.send(RenderedBlock(number, epoch, build, elapsed_ns, clipped, output.tobytes()))


def _read(connection: Connection, use: Callable[[Any], object]) -> None:
    """Read a connection in a thread; end this process after the other side has ended."""

    def run() -> None:
        with suppress(EOFError, OSError):
            while True:
                use(connection.recv())
        sleep(_GRACE_S)
        os._exit(0)

    Thread(target=run, daemon=True).start()


def _restored(
    name: str, copy: bytes | None, limit_m_s2: float
) -> GuardedGenerator | GeneratorFault | None:
    if copy is None:
        return None
    try:
        with told_as_fault(name, "reading its copy in the process that renders (pickle)"):
            generator = pickle.loads(copy)  # noqa: S301
        return GuardedGenerator(name, generator, limit_m_s2=limit_m_s2)
    except GeneratorFault as fault:
        return fault


def main(role: str, leader: Connection, other: Connection) -> None:
    """Run one of the two roles until the leader ends, or tell the leader why it failed."""
    handle_end_signals(signal.SIG_IGN)
    try:
        (fit if role == FIT else render)(leader, other)
    except (EOFError, OSError):
        return  # the leader has ended
    except MmtError as error:
        with suppress(OSError):
            leader.send(str(error))


if __name__ == "__main__":
    main(sys.argv[1], Connection(int(sys.argv[2])), Connection(int(sys.argv[3])))
