"""The base of the parts that pass frames and events on to other programs, such as LSL's and ROS's.

A stamp is the time at which a frame was measured, by another clock of this machine: the
follower's time, less the offset of its clock from the leader's, plus how far that other clock is
ahead of the leader's.
"""

import asyncio
import threading
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Final, Generic, NamedTuple, Protocol, TypeVar

from mmt.core.arrays import RecordArray
from mmt.core.errors import brief
from mmt.leader.part import Part, Session
from mmt.session.data import to_json

QUEUE_LIMIT: Final = 10_000
"""Blocks of frames, and events, that may wait: 10 s at one frame a message."""

_COMPARISONS: Final = 9


class Block(NamedTuple):
    """Frames (n,), and how far the other clock is ahead of their times (ns)."""

    frames: RecordArray
    ahead_ns: int


class Marker(NamedTuple):
    """An event."""

    time_ns: int
    """By the other clock."""
    text: str
    """A JSON object."""


class Outlet(Protocol):
    """Where frames and events go; called in the part's thread, and may wait."""

    def push_frames(self, blocks: Sequence[Block]) -> None:
        """Push blocks of frames, in their order."""

    def push_marker(self, marker: Marker) -> None:
        """Push an event."""


AnyOutlet = TypeVar("AnyOutlet", bound=Outlet)


class PublishingPart(Part, Generic[AnyOutlet]):
    """Pass frames and events on, from a thread of its own; what finds no room is counted.

    Where the other side fails, that is told; the session goes on without it.

    Parameters
    ----------
    session
        Session of the run.
    chunk_ms
        How often what has come is passed on.
    """

    table: ClassVar[str]
    """Name of the scene's table, of the thread, and of the summary."""
    compared: ClassVar[tuple[str, str]]
    """The event that tells how far the other clock is ahead, and the name of that figure (ns)."""

    def __init__(self, session: Session, chunk_ms: int) -> None:
        self._session = session
        self._chunk_s = chunk_ms / 1e3
        self._outlet: AnyOutlet | None = None
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._frames: deque[Block] = deque(maxlen=QUEUE_LIMIT)
        self._markers: deque[Marker] = deque(maxlen=QUEUE_LIMIT)
        self._clock_ahead_ns = 0
        self.error: str | None = None
        """Why nothing is passed on any more, None while it is."""
        self._told = False
        self._queued = 0
        self._unstamped = 0
        self._pushed = {"frames": 0, "events": 0}

    @property
    def name(self) -> str:
        """What a person calls it."""
        return f"[{self.table}]"

    @abstractmethod
    def clock_s(self) -> float:
        """Return the other clock's time."""

    def begin(self) -> None:
        """Compare the other clock with the leader's, and begin to pass on."""
        self._clock_ahead_ns = clock_ahead_ns(self.clock_s)
        self._thread = threading.Thread(target=self._run, name=f"mmt-{self.table}", daemon=True)
        self._thread.start()
        event, figure = self.compared
        self._session.journal.record({"event": event, figure: self._clock_ahead_ns})

    async def stop(self) -> None:
        """Pass on what waits."""
        await asyncio.to_thread(self._end)

    def close(self) -> None:
        """End the thread, and take the outlet from the network."""
        self._end()
        self._outlet = None

    # --- what is passed on

    def on_frames(self, frames: RecordArray, arrival_ns: int) -> None:
        """Queue frames (n,); those whose time is not known by this machine's clock are counted."""
        _ = arrival_ns
        remote = self._session.remote
        offset_ns = remote.clock_offset_ns if remote is not None else None
        if remote is None or offset_ns is None:
            self._unstamped += len(frames)
            return
        # the session's times go on where those of a follower that was started anew may not
        own_ns = remote.follower_time_ns - int(frames["time_ns"][-1])
        self._queued += len(frames)
        self._frames.append(Block(frames, own_ns - offset_ns + self._clock_ahead_ns))

    def on_event(self, event: dict[str, Any], sentence: str | None) -> None:
        """Queue an event, at this moment."""
        _ = sentence
        if self._thread is not None:
            time_ns = time.monotonic_ns() + self._clock_ahead_ns
            self._markers.append(Marker(time_ns, to_json(event)))

    # --- what it says

    def look(self) -> None:
        """Tell once that the other side has failed."""
        if self.error is not None and not self._told:
            self._told = True
            self._session.journal.event(f"{self.error}: the session goes on without it")

    def faults(self) -> list[str]:
        """Return why frames are not passed on."""
        link = self._session.scene.link
        never = link is not None and link.clock_hz == 0 and self._unstamped > 0
        unknown = (
            f"{self.name} cannot pass frames on: the follower's clock is another one and is not "
            "compared, as clock_hz of [link] is 0"
        )
        return [*filter(None, [self.error]), *([unknown] if never else [])]

    def summary(self, duration_s: float) -> dict[str, Any]:
        """Return how much was passed on, and how much was not."""
        _ = duration_s
        dropped = self._queued - self._pushed["frames"]
        figures = {"dropped": dropped, "unstamped": self._unstamped, "error": self.error}
        return {self.table: {**self._pushed, **figures}}

    # --- in the thread

    def _end(self) -> None:
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()

    def _run(self) -> None:
        try:
            while not self._closing.wait(self._chunk_s):
                self._push()
            self._push()
        except Exception as error:  # noqa: BLE001 - whatever stops the other side is told
            reason = brief(error).rstrip(".") or type(error).__name__
            self.error = f"{self.name} has failed: {reason}"

    def _push(self) -> None:
        """Push what has come."""
        assert self._outlet is not None  # noqa: S101 - it is kept until the thread has ended
        blocks = _taken(self._frames)
        if blocks:
            self._outlet.push_frames(blocks)
            self._pushed["frames"] += sum(len(block.frames) for block in blocks)
        for marker in _taken(self._markers):
            self._outlet.push_marker(marker)
            self._pushed["events"] += 1


def _taken(queue: deque[Any]) -> list[Any]:
    """Take what waits; the other thread may drop some of it meanwhile."""
    taken = []
    for _ in range(len(queue)):
        try:
            taken.append(queue.popleft())
        except IndexError:
            break
    return taken


def clock_ahead_ns(clock_s: Callable[[], float]) -> int:
    """Return how far a clock is ahead of the monotonic one (ns), by the quickest of some looks."""
    looks = []
    for _ in range(_COMPARISONS):
        before_ns = time.monotonic_ns()
        there_ns = round(clock_s() * 1e9)
        after_ns = time.monotonic_ns()
        looks.append((after_ns - before_ns, there_ns - (before_ns + after_ns) // 2))
    return min(looks)[1]
