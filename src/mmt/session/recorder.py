"""Record a running session from a separate thread.

The caller, an event loop at 1 kHz, only puts bytes into a queue (under a microsecond per
frame). A slow disk does not block it, and a full disk does not stop it.
"""

import errno
import importlib
import math
import os
import stat
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, NamedTuple, Self, TypeAlias

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.files.existing import exists_error, numbered
from mmt.core.frames import FRAMES_HZ, Channel, frame_dtype, ordered_channels, samples_per_frame
from mmt.session.assembling import BlockAssembler
from mmt.session.data import JsonObject, to_json
from mmt.session.mcap.writer import (
    BACKFILL_TOPIC,
    FRAMES_PER_BLOCK,
    FRAMES_TOPIC,
    SessionWriter,
)

fcntl: Final[Any] = importlib.import_module("fcntl") if find_spec("fcntl") else None
"""None on Windows, which locks open files by itself."""

QUEUE_LIMIT: Final = 10_000
"""Largest number of records in the queue: 10 s at one frame per message."""

Existing: TypeAlias = Literal["number", "refuse", "replace"]
"""If the file exists: append a number to the name, raise an error, or replace the file."""

_POLL_S = 0.1
_POLLS_PER_FLUSH = 4
"""A frame waits at most one poll in the queue and four for the flush: 0.5 s."""


class _Record(NamedTuple):
    write: Callable[..., None]
    arguments: tuple[Any, ...]
    frames: int = 0
    """Number of frames in it."""


class McapRecorder:
    """Writes a running session to an MCAP file.

    All calls must come from one thread. After a clean `close` everything recorded is in the
    file; after a crash ``mmt session recover`` saves all but the last 0.5 s. The file's log times
    are the times of the calls by this machine's clock, converted to UTC, also for frames from
    another machine.

    Parameters
    ----------
    path
        The file; missing folders are made.
    channels
        Channels of the frames.
    scene
        The resolved scene.
    session_id
        Identifies the session in the logs and summaries of both services.
    on_error
        Called once, from the recorder's thread, with the reason why recording stopped.
    queue_limit
        Largest number of records in the queue; beyond it, the oldest are dropped and counted.
    clock
        The monotonic clock (ns).
    existing
        "refuse" an existing file, "replace" it, or "number" the new one, as ``run-2.mcap``;
        the attribute `path` is the resulting name. A file to which another recorder writes
        is never replaced.
    scalars
        Also write each frame as a message of plain numbers; see `SessionWriter`.
    samples_per_frame
        Samples of acceleration, and of the output, per frame.
    session_time_s
        Returns the session time (s) at the end of the newest frame; called at the first frames
        only. If None, the first frame is at zero.

    Raises
    ------
    InputError
        The file cannot be made, exists and is refused, or another recorder writes to it.
    """

    def __init__(
        self,
        path: Path,
        *,
        channels: Sequence[Channel],
        scene: JsonObject | None = None,
        session_id: str | None = None,
        on_error: Callable[[str], None] | None = None,
        queue_limit: int = QUEUE_LIMIT,
        clock: Callable[[], int] = time.monotonic_ns,
        existing: Existing = "refuse",
        scalars: bool = False,
        samples_per_frame: int = 1,
        session_time_s: Callable[[], float] | None = None,
    ) -> None:
        self.frames = 0
        """Number of frames in the file at the last flush."""
        self.error: str | None = None
        """Why recording failed, or None."""
        self._dtype = frame_dtype(ordered_channels(channels), samples_per_frame)
        self._on_error = on_error
        self._clock = clock
        self._limit = queue_limit
        self._session_time_s = session_time_s
        self._begins_s = 0.0
        self._stream_queue: deque[_Record] = deque()
        self._rare_queue: deque[_Record] = deque(maxlen=queue_limit)
        self._recorded_frames = 0
        self._overflowed_frames = 0
        self._written_frames = 0
        self._start_ns: int | None = None
        self._closing = threading.Event()
        self.path, self._stream = _create(path, existing)
        try:
            self._writer = SessionWriter(
                self._stream,
                ordered_channels(channels),
                scene,
                session_id,
                utc_offset_ns=time.time_ns() - clock(),
                scalars=scalars,
                samples_per_frame=samples_per_frame,
            )
        except OSError as error:  # such as a full disk: the scene is written here
            with suppress(OSError):
                self._stream.close()
            raise InputError(f"recording {self.path}: {error.strerror or error}") from error
        sizes = FRAMES_PER_BLOCK * self._dtype.itemsize, FRAMES_PER_BLOCK * samples_per_frame * 4
        self._live, self._late, self._output = self._assemblers = (
            BlockAssembler(sizes[0], partial(self._write_frames, FRAMES_TOPIC), divides=True),
            BlockAssembler(sizes[0], partial(self._write_frames, BACKFILL_TOPIC), divides=True),
            BlockAssembler(sizes[1], self._write_output, divides=False),
        )
        # A daemon thread does not keep a program alive that ends without `close`.
        self._thread = threading.Thread(target=self._run, name="mmt-recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def dropped(self) -> int:
        """Number of frames missing in the file: dropped from a full queue, or lost by an error."""
        if self._thread.is_alive():
            return self._overflowed_frames
        return self._recorded_frames - self.frames

    def record_frames(self, frames: RecordArray) -> None:
        """Record frames (n,) of the recorder's channels.

        Raises
        ------
        InputError
            The frames have other channels.
        """
        if len(frames) == 0:
            return
        now_ns = self._clock()
        if self._start_ns is None:
            self._start_ns = now_ns
            if self._session_time_s is not None:
                self._begins_s = self._session_time_s() - len(frames) / FRAMES_HZ
        self._record(self._live, frames, now_ns)

    def record_backfill(self, frames: RecordArray, log_time_ns: int) -> None:
        """Record frames (n,) that arrived late, ascending, with the log time of timely arrival.

        Raises
        ------
        InputError
            The frames have other channels.
        """
        if len(frames):
            self._record(self._late, frames, log_time_ns)

    def _record(self, blocks: BlockAssembler, frames: RecordArray, log_time_ns: int) -> None:
        if frames.dtype is not self._dtype and frames.dtype != self._dtype:
            raise InputError(
                f"recording {self.path}: frames have {_described(frames.dtype)}, "
                f"expected {_described(self._dtype)}"
            )
        self._recorded_frames += len(frames)
        self._put(_Record(blocks.add, (log_time_ns, frames.tobytes()), len(frames)))

    def record_output(
        self, time_ns: int, mode: str, vibration_m_s2: npt.ArrayLike | Sequence[float]
    ) -> None:
        """Record samples (n,) written to the actuator, the first at `time_ns` of `clock`."""
        data = np.asarray(vibration_m_s2, dtype="<f4").tobytes()
        if data:
            self._put(_Record(self._output.add, (time_ns, data, mode)))

    def record_event(self, event: JsonObject) -> None:
        """Record an event at its ``time_s`` (session time), or now if it has none."""
        time_s = event.get("time_s")
        timed = isinstance(time_s, int | float) and math.isfinite(time_s)
        log_time_ns = self._log_time_ns(time_s if timed else None)
        self._put_rare(self._writer.write_event, to_json(dict(event)), log_time_ns)

    def attach_model(self, pack: Callable[[], bytes], time_s: float) -> None:
        """Attach a texture model's ``.npz`` at a session time; `pack` makes it, in the thread."""
        log_time_ns = self._log_time_ns(time_s)
        self._put_rare(lambda: self._writer.write_model(pack(), log_time_ns))

    def attach_annotations(self, data: bytes) -> None:
        """Attach the follower's annotations of the session; the last call counts."""
        self._put_rare(self._writer.write_annotations, data, self._clock())

    def close(self, timeout_s: float = 10.0) -> None:
        """Write all queued records, finish the file and wait for the recorder's thread.

        Afterwards `error` is None if the file is complete. A second call does nothing.
        """
        self._closing.set()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self._fail(f"the rest was not written within {timeout_s:g} s")

    def _log_time_ns(self, time_s: float | None) -> int:
        if time_s is None or self._start_ns is None:
            return self._clock()
        return max(0, self._start_ns + round((time_s - self._begins_s) * 1e9))

    def _put(self, record: _Record) -> None:
        if self.error is not None:
            return
        if len(self._stream_queue) >= self._limit:
            with suppress(IndexError):  # the recorder's thread may just have emptied it
                oldest = self._stream_queue.popleft()
                self._overflowed_frames += oldest.frames
        self._stream_queue.append(record)

    def _put_rare(self, write: Callable[..., None], *arguments: Any) -> None:
        if self.error is None:
            self._rare_queue.append(_Record(write, arguments))

    def _run(self) -> None:
        try:
            polls = 0
            while not self._closing.wait(_POLL_S):
                self._write_waiting()
                polls += 1
                if polls % _POLLS_PER_FLUSH == 0:
                    self._write_partial()
                    self._writer.flush()
                    self.frames = self._written_frames
            self._write_waiting()
            self._write_partial()
            self._writer.finish()
            self._stream.close()
            self.frames = self._written_frames
        except Exception as error:  # noqa: BLE001 - any error ends the recording and is reported
            reason = error.strerror if isinstance(error, OSError) else None
            self._fail(reason or f"{type(error).__name__}: {error}")
        finally:
            with suppress(OSError):  # on a full disk, closing cannot write the buffer
                self._stream.close()

    def _write_waiting(self) -> None:
        for queue in (self._rare_queue, self._stream_queue):
            for _ in range(len(queue)):
                try:
                    record = queue.popleft()
                except IndexError:  # the caller dropped records to make room
                    break
                record.write(*record.arguments)

    def _write_partial(self) -> None:
        for assembler in self._assemblers:
            assembler.flush()

    def _write_frames(self, topic: str, block: bytes, log_time_ns: int, _mode: str) -> None:
        frames = np.frombuffer(block, dtype=self._dtype)
        self._writer.write_frames(frames, log_time_ns, topic)
        self._written_frames += len(frames)

    def _write_output(self, block: bytes, time_ns: int, mode: str) -> None:
        samples = np.frombuffer(block, dtype="<f4").astype(np.float64)
        self._writer.write_output(time_ns, mode, samples)

    def _fail(self, reason: str) -> None:
        if self.error is not None:
            return
        self.error = reason
        if self._on_error is not None:
            self._on_error(reason)


def _described(dtype: np.dtype[Any]) -> str:
    return f"{dtype.names} with {samples_per_frame(dtype)} samples of acceleration each"


def _create(path: Path, existing: Existing) -> tuple[Path, BinaryIO]:
    """Create a locked, empty file; return its name and the file."""
    names = numbered(path) if existing == "number" else iter([path])
    for name in names:
        try:
            return name, _claim(name, replace=existing == "replace")
        except InputError:
            if existing != "number":
                raise
        except OSError as error:
            raise InputError(f"recording {name}: {error.strerror or error}") from error
    raise AssertionError("a number is free")


def _claim(path: Path, *, replace: bool) -> BinaryIO:
    """Open and lock a file; raise `InputError` if the file may not be replaced."""
    path.parent.mkdir(parents=True, exist_ok=True)
    stream = path.open("ab")  # truncated only once it is locked
    locked = _lock(stream)
    status = os.fstat(stream.fileno())
    regular = stat.S_ISREG(status.st_mode)
    if not locked or (regular and status.st_size and not replace):
        stream.close()
        busy = f"{path}: another leader records into it: end that one, or record into another file"
        raise InputError(f"recording {exists_error(path) if locked else busy}")
    if regular:
        stream.truncate(0)
        stream.seek(0)  # the writer takes offsets from here, not from the old end
    return stream


def _lock(stream: BinaryIO) -> bool:
    """Lock an open file until it is closed; return False if another process has locked it.

    On a file system without locks, such as some network file systems, this always succeeds.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in {errno.EWOULDBLOCK, errno.EACCES}
    return True
