"""The base of the parts that publish frames and events to other programs, by LSL or ROS.

A stamp is the time of a frame's measurement by another clock of this machine: the follower's
time, minus the offset of the follower's clock from the leader's, plus the offset of that other
clock from the leader's.
"""

import asyncio
import threading
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Final, Generic, NamedTuple, Protocol, TypeVar

from mmt.core.arrays import RecordArray
from mmt.core.errors import short_message
from mmt.leader.part import Part, Session
from mmt.session.data import to_json

QUEUE_LIMIT: Final = 10_000
"""Blocks of frames, and events, that may wait: 10 s at one frame a message."""

_COMPARISONS: Final = 9
_STEP_NS: Final = 100_000_000
"""A clock that is off by more was set, as UTC is some time after a machine has started."""


class Block(NamedTuple):
    """Frames (n,), and how far the other clock is ahead of their times (ns)."""

    frames: RecordArray
    ahead_ns: int


class Marker(NamedTuple):
    """An event."""

    time_ns: int
    """Time by the other clock."""
    text: str
    """A JSON object."""


class Outlet(Protocol):
    """Destination of frames and events; called in the part's thread, and may wait."""

    def push_frames(self, blocks: Sequence[Block]) -> None:
        """Push blocks of frames, in their order."""

    def push_marker(self, marker: Marker) -> None:
        """Push an event."""


AnyOutlet = TypeVar("AnyOutlet", bound=Outlet)


class PublishingPart(Part, Generic[AnyOutlet]):
    """Publish frames and events from a thread of its own; frames dropped for lack of room count.

    If the outlet fails, the user is told, and the session goes on without it.

    Parameters
    ----------
    session
        Session of the run.
    chunk_ms
        Time between two pushes of the waiting frames and events.
    """

    table: ClassVar[str]
    """Name of the scene's table, of the thread, and of the summary."""
    compared: ClassVar[tuple[str, str]]
    """The event that records the other clock's offset, and the name of that figure (ns)."""

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
        """Why publishing has failed, or None."""
        self._told = False
        self._queued = 0
        self._unstamped = 0
        self._pushed = {"frames": 0, "events": 0}

    @property
    def name(self) -> str:
        """Name of the part, for errors."""
        return f"[{self.table}]"

    @abstractmethod
    def clock_s(self) -> float:
        """Return the other clock's time."""

    def begin(self) -> None:
        """Compare the other clock with the leader's, and start to publish."""
        self._thread = threading.Thread(target=self._run, name=f"mmt-{self.table}", daemon=True)
        self._thread.start()
        self._compare(clock_ahead_ns(self.clock_s))

    def _compare(self, ahead_ns: int) -> None:
        """Use and record the other clock's offset."""
        self._clock_ahead_ns = ahead_ns
        event, figure = self.compared
        self._session.journal.record({"event": event, figure: ahead_ns})

    async def stop(self) -> None:
        """Publish everything that waits."""
        await asyncio.to_thread(self._end)

    def close(self) -> None:
        """End the thread, and release the outlet."""
        self._end()
        self._outlet = None

    # --- published data

    def on_frames(self, frames: RecordArray, _arrival_ns: int) -> None:
        """Queue frames (n,), or only count them if their time by this machine is not known."""
        remote = self._session.remote
        offset_ns = remote.clock_offset_ns if remote is not None else None
        if remote is None or offset_ns is None:
            self._unstamped += len(frames)
            return
        # after a restart of the follower its times may differ from the session's
        own_ns = remote.follower_time_ns - int(frames["time_ns"][-1])
        self._queued += len(frames)
        self._frames.append(Block(frames, own_ns - offset_ns + self._clock_ahead_ns))

    def on_event(self, event: dict[str, Any], _sentence: str | None) -> None:
        """Queue an event, stamped with the current time."""
        if self._thread is not None:
            time_ns = time.monotonic_ns() + self._clock_ahead_ns
            self._markers.append(Marker(time_ns, to_json(event)))

    # --- reports

    def poll(self) -> None:
        """Report once that the outlet has failed; follow the other clock if it was set."""
        if self._thread is not None:
            ahead_ns = clock_ahead_ns(self.clock_s)
            if abs(ahead_ns - self._clock_ahead_ns) > _STEP_NS:
                self._compare(ahead_ns)
        if self.error is not None and not self._told:
            self._told = True
            self._session.journal.event(f"{self.error}: the session goes on without it")

    def faults(self) -> list[str]:
        """Return why frames are not published."""
        link = self._session.scene.link
        never = link is not None and link.clock_hz == 0 and self._unstamped > 0
        unknown = (
            f"{self.name} cannot pass frames on: the follower's clock is another one and is not "
            "compared, as clock_hz of [link] is 0"
        )
        return [*filter(None, [self.error]), *([unknown] if never else [])]

    def summary(self, _duration_s: float) -> dict[str, Any]:
        """Return how many frames and events were published, and how many frames were not."""
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
        except Exception as error:  # noqa: BLE001 - any failure of the outlet is reported
            reason = short_message(error).rstrip(".") or type(error).__name__
            self.error = f"{self.name} has failed: {reason}"

    def _push(self) -> None:
        """Push everything that waits."""
        assert self._outlet is not None  # noqa: S101 - it is kept until the thread has ended
        blocks = _taken(self._frames)
        if blocks:
            self._outlet.push_frames(blocks)
            self._pushed["frames"] += sum(len(block.frames) for block in blocks)
        for marker in _taken(self._markers):
            self._outlet.push_marker(marker)
            self._pushed["events"] += 1


def _taken(queue: deque[Any]) -> list[Any]:
    """Take all items that wait; the other thread may drop some of them meanwhile."""
    taken = []
    for _ in range(len(queue)):
        try:
            taken.append(queue.popleft())
        except IndexError:
            break
    return taken


def clock_ahead_ns(clock_s: Callable[[], float]) -> int:
    """Return a clock minus the monotonic one (ns), from the quickest of several readings."""
    looks = []
    for _ in range(_COMPARISONS):
        before_ns = time.monotonic_ns()
        there_ns = round(clock_s() * 1e9)
        after_ns = time.monotonic_ns()
        looks.append((after_ns - before_ns, there_ns - (before_ns + after_ns) // 2))
    return min(looks)[1]
