"""Structured logs: one JSON object a line, written by a thread of its own.

The event loop formats a line and queues it; a disk that stalls holds up nothing, and when the
queue is full lines are dropped and counted.
"""

import json
import logging
import queue
import sys
import time
from collections.abc import Hashable
from contextlib import suppress
from datetime import UTC, datetime
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from mmt.core.errors import InputError, MmtError
from mmt.core.printable import printable

LEVELS: Final = ("debug", "info", "warning", "error")

REPEAT_PERIOD_S: Final = 1.0
"""Least time between two log lines of one kind."""

_MAX_KINDS: Final = 64
_MOST_WAITING: Final = 10_000
_LONGEST_EVENT: Final = 4000


def details(**values: object) -> dict[str, Any]:
    """Return the ``extra`` of a log call that adds these keys to its line."""
    return {"details": values}


def told(**values: object) -> dict[str, Any]:
    """Return `details` for a sentence that a person is told already: a terminal shows it once."""
    return {**details(**values), "told": True}


class Logs:
    """The log handlers of one service; leaving the context writes everything that is queued.

    Parameters
    ----------
    service
        "leader" or "follower"; written into every line.
    file
        JSON lines are appended to it; None writes none.
    level
        Lowest level of the file, by default "info"; without a file that of the lines on
        standard error, by default "warning".

    Raises
    ------
    InputError
        The level is unknown, or the file cannot be written.
    """

    def __init__(
        self, service: str, file: str | Path | None = None, level: str | None = None
    ) -> None:
        if level is not None and level not in LEVELS:
            raise InputError(f"--log-level {level}: allowed are {', '.join(LEVELS)}")
        self._lines = _JsonLines(service)
        chosen = (level or ("warning" if file is None else "info")).upper()
        self._terminal = terminal = logging.StreamHandler()
        terminal.setFormatter(_TerminalLines("%(levelname)s: %(message)s"))
        terminal.setLevel(chosen if file is None else logging.WARNING)
        terminal.addFilter(lambda record: not getattr(record, "told", False))
        self._handlers: list[logging.Handler] = [terminal]
        self._listener: QueueListener | None = None
        if file is not None:
            self._open(Path(file), chosen)
        self._root, self._own = logging.getLogger(), logging.getLogger("mmt")
        self._levels = self._own.level
        for handler in self._handlers:
            self._root.addHandler(handler)
        self._own.setLevel(chosen)

    @property
    def session_id(self) -> str | None:
        """Names the session in the lines of both services, None before it is known."""
        return self._lines.session_id

    @session_id.setter
    def session_id(self, session_id: str) -> None:
        self._lines.session_id = session_id

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._root.removeHandler(self._terminal)  # where the command line says it itself
        if isinstance(error, Exception) and self._listener is not None:
            trace_of = None if isinstance(error, MmtError) else error
            self._own.error("the service failed: %s", error, exc_info=trace_of)
        self.close()

    def close(self) -> None:
        """Write what is queued and close the file."""
        for handler in self._handlers:
            self._root.removeHandler(handler)
        self._own.setLevel(self._levels)
        if self._listener is not None:
            self._listener.stop()
            for handler in self._listener.handlers:
                handler.close()

    def _open(self, file: Path, level: str) -> None:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            writer = _FileWriter(file, encoding="utf-8")
        except OSError as error:
            raise InputError(f"--log {file}: {error.strerror or error}") from error
        waiting: queue.Queue[logging.LogRecord] = queue.Queue(_MOST_WAITING)
        handler = _BoundedQueue(waiting)
        handler.setFormatter(self._lines)
        handler.setLevel(level)
        self._listener = QueueListener(waiting, writer)
        self._listener.start()
        self._handlers.append(handler)


class RepeatLimit:
    """Allow one log line of each kind a second, and count those suppressed in between."""

    def __init__(self) -> None:
        self._next_s: dict[Hashable, float] = {}
        self._suppressed: dict[Hashable, int] = {}

    def allow(self, kind: Hashable) -> int:
        """Return 0 to suppress a line, else 1 plus the number suppressed since the last one."""
        now_s = time.monotonic()
        if 0.0 < self._next_s.get(kind, 0.0) - now_s <= REPEAT_PERIOD_S:  # or it has jumped back
            self._suppressed[kind] = self._suppressed.get(kind, 0) + 1
            return 0
        if len(self._next_s) >= _MAX_KINDS:
            self._next_s.clear()
            self._suppressed.clear()
        self._next_s[kind] = now_s + REPEAT_PERIOD_S
        return 1 + self._suppressed.pop(kind, 0)


class _JsonLines(logging.Formatter):
    def __init__(self, service: str) -> None:
        super().__init__()
        self._service = service
        self.session_id: str | None = None

    def format(self, record: logging.LogRecord) -> str:
        line: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="microseconds"),
            "level": record.levelname.lower(),
            "service": self._service,
            "session": self.session_id,
            "logger": record.name,
            "event": record.getMessage()[:_LONGEST_EVENT],
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        more = getattr(record, "details", {})
        return json.dumps({**more, **line}, default=str)


class _TerminalLines(logging.Formatter):
    """Text for a terminal, without control characters that a peer may have sent."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        record.levelname = record.levelname.lower()
        return printable(super().formatMessage(record))

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), keep="\n")  # a traceback has lines


class _BoundedQueue(QueueHandler):
    """Drop and count lines when the queue is full."""

    dropped = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        record.dropped = self.dropped
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            self.dropped += 1
        else:
            self.dropped = 0


class _FileWriter(logging.FileHandler):
    """Write lines that are already formatted; report the first error of writing only."""

    _failed = False

    def format(self, record: logging.LogRecord) -> str:
        dropped = getattr(record, "dropped", 0)
        return record.getMessage() + (
            f'\n{{"level": "warning", "event": "log lines dropped", "count": {dropped}}}'
            if dropped
            else ""
        )

    def close(self) -> None:
        with suppress(OSError):  # what is left in the buffer of a full disk
            super().close()

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: ARG002, N802
        if not self._failed:
            self._failed = True
            with suppress(OSError):  # which may go to the same full disk
                sys.stderr.write(f"warning: log {self.baseFilename}: {sys.exc_info()[1]}\n")
