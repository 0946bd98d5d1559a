"""The part that shares the model, by a process of its own that serves the listeners."""

import asyncio
import json
import sys
import time
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgpack
import numpy as np

from mmt.core.errors import MmtError
from mmt.core.running.programs import python_command
from mmt.leader.part import Part, Session, Tick
from mmt.link.incoming import RateLimit
from mmt.link.protocol import encode_event
from mmt.texture.model.file import arrays_of
from mmt.texture.model.file_arrays import pack_arrays
from mmt_share.changes import difference
from mmt_share.messages import CHANGE, MODEL, STATE, STATE_DTYPE, ModelDescription
from mmt_share.parts.listeners import Listeners
from mmt_share.store.store import Entry, ModelStore
from mmt_share.tables import Control, Sharing

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from mmt.leader.building import LeaderParts
    from mmt.leader.output.model_output import ModelOutput
    from mmt.texture.model.texture_model import TextureModel

_PERIOD_S: Final = 0.05
_MOST_WAITING: Final = 1 << 20
"""Bytes that may wait for the process; beyond, nothing new is written until it has read on."""
_LEAVE_S: Final = 3.0
"""How long the process may take to send all listeners their last messages."""


class PublishedModel(NamedTuple):
    """One state of a model for the wire: its number and its two messages."""

    number: int
    whole: bytes
    change: bytes | None
    """Change from the state before, or None for the first state."""


class ModelPublisher:
    """Make the messages of each new state of a model.

    Call it in a worker thread: it takes some 5 ms for 200 samples, most of it to compress the
    whole model.
    """

    def __init__(self) -> None:
        self._number = 0
        self._arrays: dict[str, Any] = {}

    def publish(self, model: "TextureModel", about: ModelDescription) -> PublishedModel:
        """Return the messages of a model's new state."""
        before, after = self._arrays, arrays_of(model.contents)
        self._arrays = after
        self._number += 1
        said = vars(replace(about, number=self._number, made_ns=time.monotonic_ns()))
        whole, change = encode_event(MODEL, {**said, "file": pack_arrays(after)}), None
        if before:
            changed = {**said, "since": self._number - 1, **difference(before, after)}
            change = encode_event(CHANGE, changed)
        return PublishedModel(self._number, whole, change)


class SharingPart(Part):
    """Pass the newest model and state of the hand to the process, twenty times a second.

    Parameters
    ----------
    session
        Session of the run.
    table
        The scene's ``[sharing]``.
    completing
        Provides the model.
    """

    def __init__(self, session: Session, table: Sharing, completing: "ModelOutput") -> None:
        self._session = session
        self._table = table
        self._publisher = ModelPublisher()
        self._shared: tuple[TextureModel, ModelDescription] | None = None
        self._state: Tick | None = None
        self._completing = completing
        self._process: asyncio.subprocess.Process | None = None
        self.models = 0
        """States of the model that were passed on."""
        self.listeners = Listeners()
        # all may come and go at once, but not for ever: each event is told, logged and recorded
        self._told = RateLimit(max(1.0, table.most / 50), lambda _: None, lambda _: None)
        self._reading: asyncio.Task[None] | None = None
        self._publishing: asyncio.Future[PublishedModel] | None = None
        self.port: int | None = None
        """Port for listeners, or None before the process listens."""
        self._fault = ""
        self.on_control: Callable[[dict[str, Any]], None] = lambda _: None
        """Called with each operator's message; set by `ControlPart`."""

    @classmethod
    def build(cls, session: Session, parts: "LeaderParts") -> "SharingPart | None":
        """Return the part, or None if the scene has no ``[sharing]``."""
        table = session.scene.table(Sharing)
        return None if table is None else cls(session, table, parts.completing)

    def tasks(self) -> dict[str, Coroutine[Any, Any, None]]:
        """Return the task that runs the process and passes on what is new."""
        return {"sharing": self._run()}

    def tick(self, tick: Tick) -> None:
        """Keep the tick, for the state of the hand."""
        self._state = tick

    async def stop(self) -> None:
        """Send the listeners the last model and the end of the session; end the process."""
        process = self._process
        if process is None or process.stdin is None:
            return
        if self._publishing is not None:
            await asyncio.wait([self._publishing])
        if self.port is not None:
            await self._hand_on_model()
        self._write({"end": self._session.ending.outcome})
        process.stdin.close()
        try:
            async with asyncio.timeout(_LEAVE_S):
                if self._reading is not None:
                    await asyncio.wait([self._reading])
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()

    def close(self) -> None:
        """Add the model to the store, if the scene has a store and the model is ready."""
        newest = self._now()
        if self._table.store is None or newest is None or not newest[1].ready:
            return
        model, about = newest
        session, log = self._session.scene.session, self._session.log
        description = Entry(session.name, note=f"session {log.session_id}, {about.completion}")
        try:
            entry = ModelStore(self._table.store).add(model.to_bytes(), description)
        except (OSError, MmtError) as error:
            self._session.journal.say(f"the model is not in the store {self._table.store}: {error}")
        else:
            self._session.journal.say(f"stored as {entry.name} ({entry.hash[:12]})")

    def send_to(self, operator: int, message: bytes) -> None:
        """Send a message to one operator; dropped if too much waits for the process."""
        if not self._congested:
            self._write({"to": [operator, message]})

    def admit_motion(self, operator: int | None) -> None:
        """Receive only the motion of this operator; None receives none."""
        self._write({"admit": operator})

    def faults(self) -> list[str]:
        """Return that nothing is shared any more, if the process has ended."""
        return [self._fault] if self._fault else []

    def status(self) -> dict[str, Any]:
        """Return how many are listening."""
        return {"listeners": self.listeners.now}

    def shown(self) -> dict[str, dict[str, Any]]:
        """Return the figures of the listeners."""
        return {"listeners": {"figures": self.listeners.figures}}

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return how much was shared, and with which listeners."""
        return {
            "sharing": {"port": self.port, "models": self.models, **self.listeners.summary()},
        }

    def metrics(self) -> "Iterable[Metric]":
        """Return the metrics of the listeners."""
        return self.listeners.metrics()

    async def _run(self) -> None:
        """Start the process and pass on what is new, until it ends or this is cancelled.

        Raises
        ------
        MmtError
            The process cannot listen.
        """
        table, control = self._table, self._session.scene.table(Control)
        given = {
            "control": None if control is None else control.model_dump(mode="json"),
            "sharing": table.model_dump(mode="json"),
            "welcome": {
                "session_id": self._session.log.session_id,
                "name": self._session.scene.session.name,
                "rate_hz": self._session.scene.session.rate_hz,
            },
        }
        process = self._process = await asyncio.create_subprocess_exec(
            *python_command("-m", "mmt_share.process", json.dumps(given)),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            start_new_session=sys.platform != "win32",
        )
        reading = self._reading = asyncio.create_task(self._read(process))
        while not reading.done():
            await asyncio.sleep(_PERIOD_S)
            if self.port is not None and not self._congested:
                await self._hand_on()
        reading.result()
        self.listeners.now = 0
        self._fault = "the process that shares the model has ended: the session goes on without it"
        self._session.journal.event(self._fault)

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        """Handle the lines that the process writes, until it ends.

        Raises
        ------
        MmtError
            The process cannot listen.
        """
        assert process.stdout is not None  # noqa: S101 - it was asked for
        async for raw in process.stdout:
            if not raw.endswith(b"\n"):
                return  # the process was killed while it wrote
            line = json.loads(raw)
            if "problem" in line:
                raise MmtError(f"the model cannot be shared: {line['problem']}")
            if "port" in line:
                self.port = line["port"]
                self._session.journal.event(f"shared at {self._table.url(line['port'])}")
            elif "control" in line:
                self.on_control(line)
            elif "figures" in line:
                self.listeners.take_figures(line["figures"], line.get("listened_s"))
            else:
                self.listeners.record_event(line["details"])
                if self._told.passes(0, time.monotonic_ns()):
                    self._session.journal.event(line["event"], **line["details"])

    async def _hand_on(self) -> None:
        """Pass on the state of the hand that moves the robot, if it is known, and the model."""
        state = None if self._state is None else self._state.moving
        if state is not None:
            time_s = self._session.time_s()
            message = encode_event(STATE, np.array((time_s, *state), STATE_DTYPE).tobytes())
            self._write({"state": [message, time_s, time.monotonic_ns()]})
        await self._hand_on_model()

    async def _hand_on_model(self) -> None:
        """Pass on the model if it is new; its messages are completed even if this is cancelled."""
        now = self._now()
        if now is None or now == self._shared:
            return
        publish = asyncio.to_thread(self._publisher.publish, *now)
        self._publishing = asyncio.ensure_future(publish)
        published = await asyncio.shield(self._publishing)
        self._shared = now
        self._write({"model": list(published)})
        self.models += 1

    def _now(self) -> "tuple[TextureModel, ModelDescription] | None":
        """Return the newest model and its description, or None before the first."""
        log, completing = self._session.log, self._completing
        update = log.update
        model = completing.newest
        if model is None:
            if self._shared is None:
                return None
            model, about = self._shared  # the model was reset
            return model, replace(about, ready=False)
        return model, ModelDescription(
            session_id=log.session_id,
            time_s=0.0 if update is None else update.time_s,
            ready=completing.takes_over or log.start_s is not None,
            surface=None if update is None else update.surface,
            samples=len(model.samples),
            completion=self._session.verdict().readiness,
            complete=log.stop_s is not None or self._session.scene.texture is None,
        )

    @property
    def _congested(self) -> bool:
        process = self._process
        if process is None or process.stdin is None:
            return True
        return process.stdin.transport.get_write_buffer_size() > _MOST_WAITING

    def _write(self, message: dict[str, Any]) -> None:
        process = self._process
        if process is not None and process.stdin is not None and not process.stdin.is_closing():
            process.stdin.write(msgpack.packb(message))
