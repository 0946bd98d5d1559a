"""Text streams written by a thread of their own, so that no reader and no disk blocks the program.

A stopped terminal, a pipe that nobody reads, or a stalled disk may accept nothing for any time.
The queue of texts that wait for it is bounded.
"""

import errno
import io
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import ClassVar, Final, TextIO

MOST_WAITING: Final = 10_000
"""Most texts in the queue; beyond, the oldest is dropped and counted."""
_PATIENCE_S: Final = 0.5
_RETRY_S: Final = 0.05


class QueuedStream(io.TextIOBase):
    """A text stream that never waits and never fails.

    Once its reader has gone, texts are discarded.

    Parameters
    ----------
    descriptor
        File descriptor that the thread writes to.
    encoding
        Encoding of the text; characters that it lacks are escaped.
    told_of_loss
        Returns the text to write in place of dropped texts, given their number.
    on_problem
        Called in the thread with the first error other than a reader that has gone.
    """

    patience_s: ClassVar[float | None] = None
    """Longest time (s) that `drain` waits for a reader that takes nothing; None for no limit."""

    def __init__(
        self,
        descriptor: int,
        encoding: str = "utf-8",
        told_of_loss: Callable[[int], str] = lambda _: "",
        on_problem: Callable[[OSError], None] = lambda _: None,
    ) -> None:
        self._descriptor, self._encoding = descriptor, encoding
        self._terminal = os.isatty(descriptor)
        self._told_of_loss, self._on_problem = told_of_loss, on_problem
        self._waiting: deque[str] = deque()
        self._writing = self._ended = self._gone = False
        self._dropped = self._taken = 0
        self._changed = threading.Condition()
        self.problem: OSError | None = None
        """The first error other than a reader that has gone, or None."""
        self._thread = threading.Thread(target=self._run, name="output", daemon=True)
        self._thread.start()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the text."""
        return self._encoding

    @property
    def has_pending(self) -> bool:
        """Whether something waits to be written."""
        return self._writing or bool(self._waiting)

    def fileno(self) -> int:
        """Return the file descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return self._terminal

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, text: str) -> int:
        """Queue a text; drop the oldest one if the queue is full."""
        with self._changed:
            if text and not self._gone:
                if len(self._waiting) >= MOST_WAITING:
                    self._waiting.popleft()
                    self._dropped += 1
                self._waiting.append(text)
                self._changed.notify_all()
        return len(text)

    def drain(self) -> None:
        """Wait until all is written, or until nothing was taken for `patience_s`."""
        with self._changed:
            taken = -1
            while self.has_pending and taken != self._taken:
                taken = self._taken
                self._changed.wait_for(self._progress(taken), self.patience_s)

    def end(self) -> None:
        """Drain the queue, and end the thread unless it is still blocked."""
        self.drain()
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        if not self.has_pending:
            self._thread.join()

    def _progress(self, taken: int) -> Callable[[], bool]:
        return lambda: self._taken != taken or not self.has_pending

    def _run(self) -> None:
        while text := self._next():
            data = text.encode(self._encoding, "backslashreplace")
            try:
                while data:
                    data = data[self._write(data) :]
            except OSError as error:
                self._fail(error)
            with self._changed:
                self._writing = False
                self._changed.notify_all()

    def _next(self) -> str:
        """Wait for the next text and return it; return "" at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._ended)
            if not self._waiting:
                return ""
            self._writing = True
            lost, self._dropped = self._dropped, 0
            return (self._told_of_loss(lost) if lost else "") + self._waiting.popleft()

    def _write(self, data: bytes) -> int:
        try:
            taken = os.write(self._descriptor, data)
        except BlockingIOError:  # another process has made the file non-blocking
            time.sleep(_RETRY_S)
            return 0
        with self._changed:
            self._taken += taken
            self._changed.notify_all()
        return taken

    def _fail(self, error: OSError) -> None:
        if error.errno == errno.EPIPE or (error.errno == errno.EIO and self._terminal):
            with self._changed:
                self._gone = True
                self._waiting.clear()
        elif self.problem is None:
            self.problem = error
            self._on_problem(error)


_usual: Final[dict[str, TextIO]] = {}


def queue_output() -> None:
    """Let threads write standard output and standard error, until `finish_output`.

    If both lead to the same file, they share one stream, so that lines keep their order. A stream
    without a file descriptor, such as a captured one, is left as it is.
    """
    streams: list[QueuedStream] = []
    for name in ("stdout", "stderr"):
        usual = getattr(sys, name)
        if name in _usual or usual is None:
            continue
        try:
            descriptor = usual.fileno()
        except OSError:
            continue
        usual.flush()
        same = [each for each in streams if os.path.sameopenfile(each.fileno(), descriptor)]
        stream = same[0] if same else QueuedStream(descriptor, usual.encoding)
        streams.append(stream)
        _usual[name] = usual
        setattr(sys, name, stream)


def is_queued() -> bool:
    """Return whether `queue_output` holds, so that `finish_output` is still to come."""
    return bool(_usual)


def is_behind(stream: TextIO) -> bool:
    """Return whether texts of a stream wait to be written; outdated ones can then be skipped."""
    return bool(getattr(stream, "has_pending", False))


def hurry_output() -> None:
    """Wait at most half a second, from now on, for a reader that takes nothing."""
    QueuedStream.patience_s = _PATIENCE_S


def drain_output() -> None:
    """Wait until all printed text is written.

    Raises
    ------
    OSError
        Writing failed, and not because a reader has gone.
    """
    streams = [getattr(sys, name) for name in _usual]
    for stream in streams:
        stream.drain()
    for stream in streams:
        if stream.problem is not None:
            raise stream.problem


def finish_output() -> None:
    """Write all printed text and restore the usual streams; harmless if nothing is queued."""
    while _usual:
        name, usual = _usual.popitem()
        stream = getattr(sys, name)
        setattr(sys, name, usual)
        stream.end()
    QueuedStream.patience_s = None
