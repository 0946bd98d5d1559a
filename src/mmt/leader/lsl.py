"""The part that passes frames and events on to the Lab Streaming Layer (LSL), by pylsl.

A stamp is the time at which a frame was measured, by LSL's clock on this machine: the follower's
time, less the offset of its clock from the leader's, plus what LSL's clock has more than the
leader's.
"""

import asyncio
import threading
import time
from collections import deque
from typing import Any, Final

from mmt.core.arrays import RecordArray
from mmt.core.errors import brief
from mmt.core.extras import require
from mmt.leader.lsl_streams import Block, Marker, Streams, clock_ahead_ns
from mmt.leader.part import Part, Session
from mmt.scene import Lsl
from mmt.session.data import to_json

QUEUE_LIMIT: Final = 10_000
"""Blocks of frames, and events, that may wait: 10 s at one frame a message."""

_LINGER_S: Final = 0.5
"""Time in which recipients fetch the last samples: liblsl drops them with the outlet."""


class LslPart(Part):
    """Pass frames and events on, from a thread of its own; what finds no room is counted.

    Where liblsl fails, that is told; the session goes on without it.

    Parameters
    ----------
    session
        Session of the run; its scene has [lsl].
    """

    def __init__(self, session: Session, table: Lsl) -> None:
        self._session = session
        self._table = table
        self._streams: Streams | None = None
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

    @classmethod
    def build(cls, session: Session) -> "LslPart | None":
        """Return the part.

        Raises
        ------
        InputError
            pylsl is not installed.
        """
        if session.scene.lsl is None:
            return None
        require("pylsl")
        return cls(session, session.scene.lsl)

    @property
    def name(self) -> str:
        """What a person calls it."""
        return "[lsl]"

    def connect(self) -> None:
        """Make the outlets.

        Raises
        ------
        InputError
            liblsl is not installed.
        """
        scene = self._session.scene
        self._streams = Streams(
            self._table.name,
            scene.channels(),
            self._session.rate_hz,
            self._session.log.session_id,
        )

    def begin(self) -> None:
        """Compare LSL's clock with the leader's, and begin to pass on."""
        assert self._streams is not None  # noqa: S101 - it was connected
        self._clock_ahead_ns = clock_ahead_ns(self._streams.clock_s)
        self._thread = threading.Thread(target=self._run, name="mmt-lsl", daemon=True)
        self._thread.start()
        self._session.journal.record(
            {"event": "LSL's clock compared", "lsl_clock_ahead_ns": self._clock_ahead_ns}
        )

    async def stop(self) -> None:
        """Pass on what waits, and give recipients time to fetch it."""
        await asyncio.to_thread(self._end)
        if self._streams is not None and self.error is None and self._streams.have_recipients:
            await asyncio.sleep(_LINGER_S)

    def close(self) -> None:
        """Take the outlets from the network."""
        self._end()
        self._streams = None

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
        """Tell once that liblsl has failed."""
        if self.error is not None and not self._told:
            self._told = True
            self._session.journal.event(f"{self.error}: the session goes on without it")

    def faults(self) -> list[str]:
        """Return why frames are not passed on."""
        link = self._session.scene.link
        never = link is not None and link.clock_hz == 0 and self._unstamped > 0
        unknown = (
            "[lsl] cannot pass frames on: the follower's clock is another one and is not compared, "
            "as clock_hz of [link] is 0"
        )
        return [*filter(None, [self.error]), *([unknown] if never else [])]

    def summary(self, duration_s: float) -> dict[str, Any]:
        """Return how much was passed on, and how much was not."""
        _ = duration_s
        dropped = self._queued - self._pushed["frames"]
        figures = {"dropped": dropped, "unstamped": self._unstamped, "error": self.error}
        return {"lsl": {**self._pushed, **figures}}

    # --- in the thread

    def _end(self) -> None:
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()

    def _run(self) -> None:
        try:
            while not self._closing.wait(self._table.chunk_ms / 1e3):
                self._push()
            self._push()
        except Exception as error:  # noqa: BLE001 - whatever stops liblsl is told
            self.error = f"[lsl] has failed: {brief(error) or type(error).__name__}"

    def _push(self) -> None:
        assert self._streams is not None  # noqa: S101 - it is kept until the thread has ended
        blocks = _taken(self._frames)
        if blocks:
            self._streams.push_frames(blocks)
            self._pushed["frames"] += sum(len(block.frames) for block in blocks)
        for marker in _taken(self._markers):
            self._streams.push_marker(marker)
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
