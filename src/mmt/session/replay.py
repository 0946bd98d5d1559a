"""Send a recorded session again with its true timing."""

from collections.abc import Iterable
from typing import Final, Literal

import numpy as np

from mmt.core.arrays import IntArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import FIELD_OF_CHANNEL, Channel, ordered_channels
from mmt.core.sequence_numbers import SEQUENCES
from mmt.session.data import (
    FRAME_PERIOD_NS,
    RecordedSession,
    duration_s,
    frames_of,
    missing_frames,
)

JOINT_STEP: Final = 2
"""Step of the sequence across a joint of frames that were not consecutive. One frame is
missing there, so that a receiver does not take the two sides for one stroke."""


class ReplaySource:
    """A `FollowerSource` that sends a recorded session.

    A frame is due at the start time plus its session time divided by `speed`. Deadlines are
    absolute, so no error accumulates. Each step returns every frame that is due.

    Frames are numbered from 0 and stamped with the start time plus their session time. At speed
    1 the stamp is the deadline, so a receiver's latency (arrival minus stamp) is right. At any
    other speed the stamps stay 1 ms apart, which keeps the recorded speeds and spectra; a latency
    then has no meaning.

    Missing frames are not filled in. With gaps = "keep" the sequence and the time jump as
    recorded, and nothing is sent during the gap. With "skip" the gap is closed up to one missing
    frame and 2 ms. Loops are joined in the same way, and so is a recording in which sequence or
    time decreases because its follower restarted.

    Parameters
    ----------
    session
        The session to send.
    channels
        The channels to send; the session must have them.
    speed
        Factor by which session time passes faster.
    loop
        Start again at the end, endlessly.
    gaps
        "keep" or "skip", see above.
    samples_per_frame
        Samples of acceleration per frame. If acceleration is sent, the session must have as many.

    Raises
    ------
    InputError
        The session has no frames, lacks a channel or has another rate of acceleration, or the
        speed is not above zero or not finite.
    """

    def __init__(
        self,
        session: RecordedSession,
        channels: Iterable[Channel],
        *,
        speed: float = 1.0,
        loop: bool = False,
        gaps: Literal["keep", "skip"] = "keep",
        samples_per_frame: int = 1,
    ) -> None:
        if not 0 < speed < float("inf"):
            raise InputError(f"replay speed is {speed}, it must be above zero")
        self._session = session
        self._speed = speed
        self._loop = loop
        self._gaps = gaps
        self._frames = _chosen_frames(session, ordered_channels(channels), samples_per_frame)
        steps, times_ns = _plan(session.frames, close_gaps=gaps == "skip")
        self._sequence: IntArray = np.concatenate([[0], np.cumsum(steps)])
        self._time_ns: IntArray = np.concatenate([[0], np.cumsum(times_ns)])
        self._next = 0
        self._loops = 0
        self._start_ns = 0
        self._closed = False

    def start(self, start_time_ns: int) -> None:
        """Start; the first frame is due at this time of the follower's clock."""
        self._start_ns = start_time_ns
        self._next = 0
        self._loops = 0

    def step(
        self,
        elapsed: int,  # noqa: ARG002 - deadlines are absolute
        now_ns: int,
        command_position_mm: tuple[float, float, float] | None = None,  # noqa: ARG002
    ) -> RecordArray:
        """Return the frames (n,) that are due; n is 0 in a gap and after the end."""
        session_ns = int((now_ns - self._start_ns) * self._speed)
        blocks = []
        while not self.finished:
            due_ns = session_ns - self._loops * self._loop_ns
            end = int(self._time_ns.searchsorted(due_ns, side="right"))
            if end > self._next:
                blocks.append(self._block(self._next, end))
                self._next = end
            if end < len(self._frames) or not self._loop:
                break
            self._next = 0
            self._loops += 1
        if len(blocks) == 1:
            return blocks[0]
        return np.concatenate([self._frames[:0], *blocks])

    @property
    def _loop_ns(self) -> int:
        return int(self._time_ns[-1]) + JOINT_STEP * FRAME_PERIOD_NS

    def _block(self, begin: int, end: int) -> RecordArray:
        block = self._frames[begin:end].copy()
        sequence_base = self._loops * (int(self._sequence[-1]) + JOINT_STEP)
        time_base_ns = self._start_ns + self._loops * self._loop_ns
        # In an endless loop the 32-bit sequence wraps after 49 days.
        block["sequence"] = (self._sequence[begin:end] + sequence_base) % SEQUENCES
        block["time_ns"] = self._time_ns[begin:end] + time_base_ns
        return block

    @property
    def finished(self) -> bool:
        """Whether the last frame was sent, or the source was closed; a loop has no last frame."""
        return self._closed or (self._next >= len(self._frames) and not self._loop)

    @property
    def annotations(self) -> bytes:
        """The annotations of the recorded session, such as the simulated truth."""
        return self._session.annotations

    def describe(self) -> str:
        """Describe the replay in one line."""
        frames = self._session.frames
        words = [f"replay of {self._session.path.name or 'a session'}"]
        words.append(f"{duration_s(frames):.1f} s, {len(frames)} frames")
        missing = missing_frames(frames)
        if missing:
            treated = "kept" if self._gaps == "keep" else "closed up"
            words.append(f"{missing} missing ({treated})")
        if self._speed != 1:
            words.append(f"{self._speed:g} times as fast")
        if self._loop:
            words.append("looped")
        return ", ".join(words)

    def close(self) -> None:
        """Stop sending."""
        self._closed = True


def _chosen_frames(
    session: RecordedSession, channels: tuple[Channel, ...], samples_per_frame: int
) -> RecordArray:
    name = session.path
    if len(session.frames) == 0:
        raise InputError(f"replay of {name}: the session holds no frames")
    lacking = [channel for channel in channels if channel not in session.channels]
    if lacking:
        raise InputError(
            f"replay of {name}: the session has no {' and no '.join(lacking)}, "
            f"which the scene needs; it has {', '.join(session.channels)}"
        )
    recorded = session.samples_per_frame
    if "acceleration" in channels and recorded != samples_per_frame:
        raise InputError(
            f"replay of {name}: its acceleration is at {1000 * recorded} Hz, the scene's at "
            f"{1000 * samples_per_frame}: write acceleration_rate_hz = {1000 * recorded} under "
            "[session], or import a file that has more of it by 'mmt session import "
            f"--acceleration-rate {1000 * samples_per_frame}'"
        )
    frames = session.frames
    values = {channel: frames[FIELD_OF_CHANNEL[channel]] for channel in channels}
    return frames_of(frames["sequence"], frames["time_ns"], values, samples_per_frame)


def _plan(frames: RecordArray, *, close_gaps: bool) -> tuple[IntArray, IntArray]:
    """Return the steps (n - 1,) of sequence and of time (ns) from each frame to the next."""
    sequence: IntArray = frames["sequence"].astype(np.int64)
    stamps_ns: IntArray = frames["time_ns"].astype(np.int64)
    steps, times_ns = np.diff(sequence), np.diff(stamps_ns)
    joints = (steps <= 0) | (times_ns < 0)
    if close_gaps:
        joints |= steps > 1
    steps[joints] = JOINT_STEP
    times_ns[joints] = JOINT_STEP * FRAME_PERIOD_NS
    return steps, times_ns
