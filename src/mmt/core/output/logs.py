"""Structured logs: one JSON object a line, written by a thread of its own.

A disk that stalls does not block the service: if the queue is full, the oldest lines are dropped
and counted.
"""

import json
import logging
import os
import sys
import time
from collections.abc import Hashable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from mmt.core.errors import InputError, MmtError, naming, printable
from mmt.core.output.streams import QueuedStream

LEVELS: Final = ("debug", "info", "warning", "error")

REPEAT_PERIOD_S: Final = 1.0
"""Least time between two log lines of one kind."""

_MAX_KINDS: Final = 64
_LONGEST_EVENT: Final = 4000


def details(**values: object) -> dict[str, Any]:
    """Return the ``extra`` of a log call that adds these keys to its line."""
    return {"details": values}


def details_for_log(**values: object) -> dict[str, Any]:
    """Return `details` for an event that the user sees anyway, so that the terminal omits it."""
    return {**details(**values), "told": True}


class Logs:
    """The log handlers of one service; leaving the context writes all queued lines.

    Parameters
    ----------
    service
        "leader" or "follower"; written into every line.
    file
        JSON lines are appended to it; None writes none.
    level
        Lowest level in the file, by default "info"; without a file, lowest level on standard
        error, by default "warning".

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
        self._file: QueuedStream | None = None
        if file is not None:
            self._open(Path(file), chosen)
        self._root, self._own = logging.getLogger(), logging.getLogger("mmt")
        self._levels = self._own.level
        for handler in self._handlers:
            self._root.addHandler(handler)
        self._own.setLevel(chosen)

    @property
    def session_id(self) -> str | None:
        """Identifier of the session in the lines of both services; None before it is known."""
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
        self._root.removeHandler(self._terminal)  # the command line itself shows errors there
        if isinstance(error, Exception) and self._file is not None:
            trace_of = None if isinstance(error, MmtError) else error
            self._own.error("the service failed: %s", error, exc_info=trace_of)
        self.close()

    def close(self) -> None:
        """Write all queued lines and close the file."""
        for handler in self._handlers:
            self._root.removeHandler(handler)
        self._own.setLevel(self._levels)
        if self._file is not None:
            self._file.end()
            if not self._file.has_pending:
                os.close(self._file.fileno())

    def _open(self, file: Path, level: str) -> None:
        with naming(f"--log {file}"):
            file.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)

        def warn(problem: OSError) -> None:
            with suppress(OSError):  # standard error may be on the same full disk
                sys.stderr.write(f"warning: log {file}: {problem}\n")

        self._file = QueuedStream(descriptor, told_of_loss=_lost_lines, on_problem=warn)
        handler = logging.StreamHandler(self._file)
        handler.setFormatter(self._lines)
        handler.setLevel(level)
        self._handlers.append(handler)


class RepeatLimit:
    """Allow one log line of each kind in `period_s`; count the suppressed ones."""

    def __init__(self, period_s: float = REPEAT_PERIOD_S) -> None:
        self._period_s = period_s
        self._next_s: dict[Hashable, float] = {}
        self._suppressed: dict[Hashable, int] = {}

    def allow(self, kind: Hashable) -> int:
        """Return 0 to suppress a line, else 1 plus the number suppressed since the last one."""
        now_s = time.monotonic()
        if 0.0 < self._next_s.get(kind, 0.0) - now_s <= self._period_s:  # more: it jumped back
            self._suppressed[kind] = self._suppressed.get(kind, 0) + 1
            return 0
        if len(self._next_s) >= _MAX_KINDS:
            self._next_s.clear()
            self._suppressed.clear()
        self._next_s[kind] = now_s + self._period_s
        return 1 + self._suppressed.pop(kind, 0)

    def warn(self, log: logging.Logger, sentence: str) -> None:
        """Log a warning if the last one is long ago, with the number since then."""
        if times := self.allow("warning"):
            more = f" ({times} since the last such line)" if times > 1 else ""
            log.warning("%s%s", sentence, more)


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


def _lost_lines(count: int) -> str:
    return f'{{"level": "warning", "event": "log lines dropped", "count": {count}}}\n'
