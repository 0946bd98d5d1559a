"""The follower service: one event loop that ticks, measures and streams."""

import asyncio
import logging
import math
import time
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final

from mmt.arrays import RecordArray
from mmt.devices.protocols import Vector
from mmt.errors import FAILED, MmtError
from mmt.follower.guarding import CommandGuard
from mmt.follower.sources import build_source
from mmt.link.access import Access
from mmt.link.client import FollowerClient, FollowerEvents
from mmt.link.protocol import FollowerHello
from mmt.process import ProcessMeter, prefer_even_ticks
from mmt.scene import Link, Scene, Texture
from mmt.ticking import Ticker

if TYPE_CHECKING:
    from mmt.follower.feedback import FollowerFeedback
    from mmt.link.extra import ExtraEvent
    from mmt.link.listening import Listener
    from mmt.link.network import EmulatedNetwork

LOG: Final = logging.getLogger("mmt.follower")

_UNWANTED: Final = (FAILED, f"leader {FAILED}", "leader lost")


@dataclass(frozen=True)
class FollowerSummary:
    """What the follower did.

    ``outcome`` is "source ended", "leader stopped (...)", "stopped" (by the person),
    "leader lost", "leader failed: ..." or "failed: ...", each with what failed.
    """

    outcome: str
    session: dict[str, Any]
    link: dict[str, Any]
    ticks: dict[str, Any]
    process: dict[str, Any]
    commands: dict[str, Any] = field(default_factory=dict)
    backfill: dict[str, Any] = field(default_factory=dict)
    devices: dict[str, Any] = field(default_factory=dict)
    feedback: dict[str, Any] = field(default_factory=dict)

    @property
    def problem(self) -> str | None:
        """What made the run end in a way that nobody wanted, None where nothing did."""
        return self.outcome if self.outcome.startswith(_UNWANTED) else None

    def as_dict(self) -> dict[str, Any]:
        """Return the summary for a program."""
        return asdict(self)


class FollowerService:
    """Stream one scene's source to the leader.

    Parameters
    ----------
    scene
        What to run; it must have a source.
    url
        Of the leader, ``http://host:port``; None takes the scene's ``[link]``.
    on_event
        Called with a sentence whenever something happens that a person wants to know.
    on_session
        Called with the leader's name of the session, as soon as it is known.
    """

    def __init__(
        self,
        scene: Scene,
        url: str | None = None,
        *,
        on_event: Callable[[str], None] | None = None,
        on_session: Callable[[str], None] | None = None,
    ) -> None:
        self.scene = scene
        self._link = scene.link or Link()
        self.url = url or self._link.url()
        self._tell = on_event or (lambda _: None)
        self._on_session = on_session or (lambda _: None)
        self.session_id: str | None = None
        self._access = Access.of(self._link)
        self.source = build_source(scene)
        self._feedback = self._make_feedback()
        self.client = FollowerClient(
            self.url,
            FollowerHello(
                channels=scene.channels(),
                source=scene.source or "",
                rate_hz=scene.session.rate_hz,
                frames_per_message=self._link.frames_per_message,
                annotations=self.source.annotations,
                keep_frames=scene.keep_frames(),
                run_id=uuid.uuid4().hex,
                extra="" if self._feedback is None else self._feedback.event,
            ),
            FollowerEvents(
                on_commands=self._on_commands,
                on_session=self._take_session,
                on_stop=self._on_stop,
                on_lost=self._on_lost,
                on_jump=lambda jump: self._say(f"clocks: the leader's {jump.describe()}"),
                on_error=self._fail,
            ),
            network=self._emulated_network(),
            access=self._access,
            clock_hz=self._link.clock_hz,
            extra=self._extra_event(),
        )
        self.ticker = Ticker(round(1e9 / scene.session.rate_hz), self._tick)
        self.guard = self._make_guard()
        watch = getattr(self.source, "watch", None)
        if watch is not None:  # a source of devices
            watch(self._on_device)
        self._newest: RecordArray | None = None
        self._ended = asyncio.Event()
        self._outcome = "source ended"
        self._fault: Exception | None = None
        self._lost_deadline: asyncio.TimerHandle | None = None

    async def run(self, on_ready: Callable[[], None] | None = None) -> FollowerSummary:
        """Connect, stream until the source or the leader ends, and return the summary.

        A fault in the midst of it, such as a device that fails, ends the session; the leader
        is told, and the summary says so.

        Raises
        ------
        MmtError
            The session cannot begin: the leader does not answer, or refuses.
        """
        prefer_even_ticks()
        if on_ready is not None:
            on_ready()
        meter = ProcessMeter()
        listener: Listener | None = None
        try:
            listener = await self._serve_metrics()
            await self._connect()
            if not self._ended.is_set():
                meter = ProcessMeter()
                await self._stream()
        finally:
            self.ticker.stop()
            if self._lost_deadline is not None:
                self._lost_deadline.cancel()
            await self.client.end(self._outcome)
            await self.client.disconnect()
            if listener is not None:
                await listener.stop()
            self._close_source()
        cost = meter.read()
        return FollowerSummary(
            outcome=self._outcome,
            session={"id": self.session_id},
            link=asdict(self.client.statistics),
            ticks=asdict(self.ticker.statistics),
            process={
                "core_share": round(cost.core_share, 3),
                "memory_mb": round(cost.memory_mb, 1),
            },
            devices=getattr(self.source, "summary", {}),
            commands=self.guard.summary if self.guard is not None else {},
            backfill=self.client.backfill,
            feedback=dict(self._feedback.summary) if self._feedback is not None else {},
        )

    def stop(self, outcome: str = "stopped") -> None:
        """End the session; `run` returns with the summary."""
        if not self._ended.is_set():
            self._outcome = outcome
            self._ended.set()

    def _say(self, sentence: str) -> None:
        self._tell(sentence)
        LOG.info(sentence)

    def _take_session(self, session_id: str) -> None:
        if session_id != self.session_id:
            self.session_id = session_id
            self._on_session(session_id)
            LOG.info("connected to the leader")

    def _emulated_network(self) -> "EmulatedNetwork | None":
        if self.scene.network is None:
            return None
        from mmt.link.network import EmulatedNetwork

        return EmulatedNetwork(self.scene.network, "up", self.scene.session.seed, self._say)

    async def _serve_metrics(self) -> "Listener | None":
        metrics = self.scene.metrics
        if metrics is None or metrics.follower_port is None:
            return None
        from mmt.follower.metrics import serve_metrics

        return await serve_metrics(self, metrics.follower_port, self._access)

    async def _connect(self) -> None:
        """Connect, unless the person stops first."""
        connecting = asyncio.create_task(self.client.connect(self._link.patience_s))
        ended = asyncio.create_task(self._ended.wait())
        try:
            await asyncio.wait([connecting, ended], return_when=asyncio.FIRST_COMPLETED)
            if connecting.done():
                connecting.result()
        finally:
            connecting.cancel()
            ended.cancel()
            await asyncio.gather(connecting, ended, return_exceptions=True)

    async def _stream(self) -> None:
        """Stream until the end, or until the source fails."""
        ended = asyncio.create_task(self._ended.wait())
        try:
            self.source.start(time.monotonic_ns())
            self.ticker.start()
            ticking = asyncio.create_task(self.ticker.wait())
            await asyncio.wait([ended, ticking], return_when=asyncio.FIRST_COMPLETED)
            self.ticker.stop()
            await ticking
        except Exception as error:  # noqa: BLE001 - what is no MmtError is raised below
            self._fail(error)
        finally:
            ended.cancel()
        if self._fault is not None and not isinstance(self._fault, MmtError):
            raise self._fault  # no fault of devices or files, but a mistake in the program

    def _fail(self, fault: Exception) -> None:
        """End the session because something in it does not work."""
        self._fault = self._fault or fault
        self.stop(f"{FAILED}{fault}")

    def _close_source(self) -> None:
        """Close the source; a device that does not close must not hide what went before."""
        try:
            self.source.close()
        except MmtError as error:
            self._say(str(error))

    def _tick(self, elapsed: int) -> None:
        guard = self.guard
        command = guard.step(elapsed, self._measured) if guard is not None else None
        feedback = self._feedback
        if feedback is not None:
            command = feedback.command(command)
        frames = self.source.step(elapsed, time.monotonic_ns(), command)
        if len(frames):
            self._newest = frames
            if feedback is not None:
                news = feedback.measured(frames)
                if news is not None:
                    self.client.send_extra(news)
            self.client.send_frames(frames)
        if self.source.finished:
            self.stop("source ended")

    def _make_guard(self) -> CommandGuard | None:
        if self.scene.replay is not None:
            return None  # a recording follows no commands
        return CommandGuard(
            self._link,
            self.scene.session.rate_hz,
            (self.scene.texture or Texture()).normal,
            measures_position="position" in self.scene.channels(),
            say=self._say,
        )

    def _make_feedback(self) -> "FollowerFeedback | None":
        table = self.scene.force_feedback
        if table is None or table.method == "streamed":
            return None
        from mmt.follower.feedback import build_feedback

        return build_feedback(table, self.scene.session.rate_hz)

    def _extra_event(self) -> "ExtraEvent | None":
        feedback = self._feedback
        if feedback is None:
            return None
        from mmt.link.extra import ExtraEvent

        return ExtraEvent(feedback.event, feedback.dtype, feedback.take_records, feedback.restart)

    def _measured(self) -> Vector | None:
        """Return the robot's newest measured position, None before there is one."""
        if self._newest is None:
            return None
        x, y, z = self._newest["position_mm"][-1].tolist()
        return (x, y, z) if math.isfinite(x + y + z) else None

    def _on_device(self, lost: bool, sentence: str) -> None:
        """Do what the scene says while a device is lost."""
        devices = self.scene.devices
        if self.guard is None or devices is None or devices.on_lost == "stop":
            return
        if lost:
            self._newest = None
            self.guard.halt(devices.on_lost)
        else:
            self.guard.release()
        does = "holding" if devices.on_lost == "hold" else "retracting"
        self._say(f"{sentence}{f': {does}' if lost else ': taking commands again'}")

    def _on_commands(self, commands: RecordArray, arrival_ns: int) -> None:
        if self.guard is not None:
            self.guard.take(commands, arrival_ns)

    def _on_stop(self, reason: str) -> None:
        self._say(f"the leader ended the session: {reason}")
        self.stop(f"leader {reason}" if reason.startswith(FAILED) else f"leader stopped ({reason})")

    def _on_lost(self, reason: str) -> None:
        patience_s = self._link.patience_s
        self._say(f"leader lost ({reason}), trying again for {patience_s:g} s")
        if self._lost_deadline is not None:
            self._lost_deadline.cancel()
        loop = asyncio.get_running_loop()
        self._lost_deadline = loop.call_later(patience_s, self._give_up)

    def _give_up(self) -> None:
        if not self.client.connected:
            self.stop("leader lost")
