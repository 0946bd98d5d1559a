"""The leader's part that renders from another method's generator, which runs in two processes.

One process fits the generator, the other renders. The generator gets the samples of each update of
our model, once that update is judged. Our model is built all the same: it decides on completion, is
saved and shared, and is rendered until the generator is ready, and after the generator has failed.
"""

import os
import statistics
import subprocess
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import TYPE_CHECKING, Any, Final

import psutil

from mmt.core.errors import InputError, MmtError
from mmt.core.running.child_process import ChildProcess
from mmt.core.running.process import ProcessCost, ProcessMeter
from mmt.core.running.programs import import_path
from mmt.leader.part import Part, Session
from mmt_methods.generators.process import FIT, RENDER, RESET
from mmt_methods.generators.registry import origin
from mmt_methods.generators.vibration import GeneratedVibration

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.leader.building import LeaderParts
    from mmt.leader.modelling.pipeline import Modelling
    from mmt.leader.output.renderer import Renderer
    from mmt.texture.online.updates import NewSamples

_LONGEST_START_S: Final = 120.0
LONGEST_UPDATE_S: Final = 60.0
"""A fit that takes longer ends the generator."""


class GeneratingPart(Part):
    """Run both processes, hand on samples, and report costs, and why the processes end.

    Parameters
    ----------
    session
        Session of the run.
    generator
        The generator's name, as the scene has it.
    modelling
        Modelling whose samples are handed on.
    synthesizer
        Renders our model until the generator is ready, and after it has failed.

    Raises
    ------
    InputError
        There is no such generator.
    """

    def __init__(
        self,
        session: Session,
        generator: str,
        modelling: "Modelling",
        synthesizer: "Renderer",
    ) -> None:
        self._session, self._generator = session, generator
        self._origin = origin(generator)
        table = session.scene.rendering
        fade_s = table.crossfade_ms / 1000 if table is not None else 0.0
        fade = round(fade_s * session.acceleration_rate_hz)
        self.vibration = GeneratedVibration(generator, synthesizer, fade, session.samples_per_frame)
        self._crossfade_samples = fade
        self._processes: dict[str, ChildProcess] = {}
        self._ways: dict[str, Connection] = {}
        self._sender = ThreadPoolExecutor(max_workers=1, thread_name_prefix="generator")
        self._waiting = 0  # updates not fitted yet
        self._since_s = 0.0  # latest possible start of the current fit
        self._seconds: list[float] = []
        self._segments = self._ended_looks = 0
        self._heard = False
        self._heard_from_s: float | None = None
        self._ended = False
        self._meters: list[ProcessMeter] = []  # empty before both are ready
        self._cost: dict[str, float] = {}
        modelling.return_samples(self._feed)

    @classmethod
    def build(cls, session: Session, parts: "LeaderParts") -> "GeneratingPart | None":
        """Return the part; no process is started yet.

        Raises
        ------
        InputError
            There is no such generator.
        """
        table, modelling, rendering = session.scene.rendering, parts.modelling, parts.synthesizing
        if table is None or table.generator is None or modelling is None or rendering is None:
            return None
        made = parts.generating = cls(session, table.generator, modelling, rendering.synthesizer)
        return made

    @property
    def name(self) -> str:
        """Name of the generator in messages."""
        return f"generator {self._generator}"

    def connect(self) -> None:
        """Start both processes, and wait until they have imported the generator's package.

        Raises
        ------
        InputError
            The builder cannot be imported, or is no builder.
        """
        between = Pipe()
        for role, end in zip((FIT, RENDER), between, strict=True):
            ours, theirs = Pipe()
            self._ways[role] = ours
            self._processes[role] = _start(role, theirs, end)
            theirs.close()
        for end in between:
            end.close()
        session, scene = self._session, self._session.scene
        texture = scene.texture
        setup = {
            "name": self._generator,
            "settings": texture.settings(session.samples_per_frame) if texture else None,
            "limit_m_s2": scene.actuator.limit_m_s2 if scene.actuator else 0.0,
            "seed": scene.session.seed,
            "crossfade_samples": self._crossfade_samples,
        }
        for role in (FIT, RENDER):
            with suppress(OSError):  # its reason is read below
                self._ways[role].send(setup)
        for role in (FIT, RENDER):
            self._await_ready(role)
        self.vibration.channel = self._ways[RENDER]
        self._meters = [ProcessMeter(process.pid) for process in self._processes.values()]

    def close(self) -> None:
        """End both processes."""
        self._end()
        for process in self._processes.values():
            process.close()
        self._sender.shutdown(cancel_futures=True)
        for way in self._ways.values():
            way.close()

    def start_rendering(self) -> None:
        """Render the generator instead of our model: the start criterion is met."""
        self.vibration.wanted = True

    def reset(self) -> None:
        """Start over, as our model does."""
        self.vibration.wanted = False
        self.vibration.epoch += 1
        self._send(RESET)

    def poll(self) -> None:
        """Read news of fits; report if rendering from the generator starts or ends, and why."""
        vibration = self.vibration
        if self._ended:
            return
        vibration.fault = self._fault() or vibration.fault
        self._ended = vibration.fault is not None
        if vibration.is_rendered != self._heard or self._ended:
            self._heard = vibration.is_rendered
            if self._heard and self._heard_from_s is None:
                self._heard_from_s = self._session.journal.time_s
            self._tell()
        if self._ended:
            self._end()

    # --- reports

    def faults(self) -> list[str]:
        """Return why the generator has failed, empty if it has not."""
        return [] if self.vibration.fault is None else [self.vibration.fault]

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return counts and times of fits and blocks, and the generator's state."""
        vibration, seconds = self.vibration, self._seconds
        block = [vibration.times.quantile_ms(fraction) for fraction in (0.5, 0.99)]
        return {
            "generator": {
                "name": self._generator,
                "origin": self._origin,
                "heard_from_s": self._heard_from_s,
                "fault": vibration.fault,
                "fits": len(seconds),
                "segments": self._segments,
                "fit_median_ms": round(1e3 * statistics.median(seconds), 2) if seconds else None,
                "fit_longest_ms": round(1e3 * max(seconds), 2) if seconds else None,
                "blocks": vibration.blocks,
                "late_blocks": vibration.late,
                "block_p50_ms": block[0],
                "block_p99_ms": block[1],
                "clipped": vibration.clipped,
                **self._cost,
            }
        }

    def metrics(self) -> "Iterable[Metric]":
        """Return metrics of fits and blocks."""
        from mmt.core.output.exposition import counter, gauge

        vibration = self.vibration
        yield gauge("generator_heard", "Whether the generator is rendered.", vibration.is_rendered)
        yield counter("generator_fits", "Fits of the generator.", len(self._seconds))
        yield counter("generator_fit_seconds", "Time spent on fits.", sum(self._seconds))
        yield counter("generator_blocks", "Blocks asked of the generator.", vibration.blocks)
        yield counter("generator_late_blocks", "Blocks that came too late.", vibration.late)

    # --- the processes

    def _await_ready(self, role: str) -> None:
        way = self._ways[role]
        try:
            answer = way.recv() if way.poll(_LONGEST_START_S) else "no answer"
        except (EOFError, OSError):
            answer = "its process has ended"
        if answer == "no answer":
            raise MmtError(f"{self.name}: not imported within {_LONGEST_START_S:g} s")
        if answer != "ready":
            raise InputError(
                answer if answer.startswith("generator ") else f"{self.name}: {answer}"
            )

    def _feed(self, samples: "NewSamples") -> None:
        """Hand on the samples of an update of our model."""
        if self.vibration.fault is None:
            if self._waiting == 0:
                self._since_s = time.monotonic()
            self._waiting += 1
            self._send(samples)

    def _send(self, item: object) -> None:
        """Send in a thread, so that the event loop never waits for the process."""
        if self._processes and not self._ended:
            self._sender.submit(self._ways[FIT].send, item)

    def _fault(self) -> str | None:
        """Read messages of the process that fits; return why it has failed, or None."""
        way = self._ways[FIT]
        try:
            while way.poll():
                answer = way.recv()
                if isinstance(answer, str):
                    return answer
                seconds, self._segments, taken = answer
                self._waiting -= taken
                self._since_s = time.monotonic()
                if seconds:
                    self._seconds.append(seconds)
        except (EOFError, OSError):
            self._ended_looks += 1  # the other process may tell why before the next look
            return (
                f"{self.name}: the process that fits has ended" if self._ended_looks > 1 else None
            )
        if self._waiting and time.monotonic() - self._since_s > LONGEST_UPDATE_S:
            return f"{self.name}: a fit took longer than {LONGEST_UPDATE_S:g} s"
        return None

    def _tell(self) -> None:
        vibration = self.vibration
        details = {
            "generator": self._generator,
            "origin": self._origin,
            "heard": vibration.is_rendered,
        }
        sentence = vibration.fault or f"{self.name} ({self._origin})"
        if vibration.is_rendered:
            sentence += " renders"
        elif vibration.wanted or vibration.fault is not None:
            sentence += ": our model renders in its place"
        else:
            sentence += " has begun anew"
        self._session.journal.event(sentence, **details)

    def _end(self) -> None:
        """Kill both processes without waiting, and keep their costs."""
        if self._meters and not self._cost:
            share = memory_mb = 0.0
            for meter in self._meters:
                with suppress(psutil.Error):  # it has ended by itself
                    cost = meter.read()
                    share, memory_mb = share + cost.core_share, memory_mb + cost.memory_mb
            self._cost = ProcessCost(share, memory_mb).as_dict()
        for process in self._processes.values():
            process.kill()


def _start(role: str, *connections: Connection) -> ChildProcess:
    """Start a process with our import path, which Ctrl-C does not reach.

    It stays in our session: if Linux groups processes by session, niceness counts only within one.
    """
    descriptors = [connection.fileno() for connection in connections]
    return ChildProcess(
        *("-m", "mmt_methods.generators.process", role, *map(str, descriptors)),
        own_session=False,
        stdin=subprocess.DEVNULL,
        stdout=2,  # a program may read the leader's stdout
        pass_fds=descriptors,
        env={**os.environ, "PYTHONPATH": import_path()},
    )
