"""Read files of foreign formats in a child process, within limits of memory and time.

What reading takes is decided by the file's content and by another project's library, which may
also end its process: 2 kB can declare a data set that fills the memory. `DECODED_HERE` are the
formats that mmt decodes itself, in memory that the file's size bounds.

The parent looks at the child's memory and ends it. With a limit by the system, allocations would
fail instead, which libraries report as damage of the file, or wait for ever.
"""

import logging
import math
import os
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from logging.handlers import QueueHandler
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final, NamedTuple, ParamSpec, TypeVar

import psutil

from mmt.core.errors import InputError, MmtError, short_message
from mmt.core.files.existing import size_bytes
from mmt.core.running.child_process import ChildProcess, Parent
from mmt.core.running.programs import import_path, when_parent_ends
from mmt.session.importing.options import ImportOptions

TEXTS: Final = (".csv", ".txt", ".tsv", ".dat", ".lvm", ".log", ".asc")
DECODED_HERE: Final = (*TEXTS, ".npy", ".npz", ".wav")

_MEMORY_GB: Final = 2.0
_MEMORY_PER_BYTE: Final = 16
"""Parquet takes 6 times its size, other formats less; a recording rarely packs much better."""
_TIME_S: Final = 60.0
_TIME_S_PER_MB: Final = 5.0
"""Workbooks take 2 s/MB on two busy cores, bags of short messages 0.7, other formats 0.03."""
_LOOK_S: Final = 0.01

_PROGRAM: Final = "from mmt.session.importing.reading_child import main; main()"

reads_here = threading.Event()
"""Set in the child: this process reads foreign formats itself."""

_P = ParamSpec("_P")
_T = TypeVar("_T")


class _Limits(NamedTuple):
    memory_gb: float
    time_s: float

    @classmethod
    def of(cls, path: Path, options: ImportOptions) -> "_Limits":
        """Return the limits for a file or folder: as the options say, else by its size."""
        size = size_bytes(path)
        return cls(
            options.reading_memory_gb or _MEMORY_GB + _MEMORY_PER_BYTE * size / 1e9,
            options.reading_time_s or _TIME_S + _TIME_S_PER_MB * size / 1e6,
        )


class _Answer(NamedTuple):
    error: Exception | None
    result: Any
    log: list[logging.LogRecord]
    warned: list[tuple[str, type[Warning], str, int]]


def read_limited(
    path: Path, options: ImportOptions, read: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs
) -> _T:
    """Return ``read(*args, **kwargs)``, called in a child if the format of `path` is foreign.

    `read` is a function of a module. Its arguments and result are pickled; its log, warnings and
    errors become those of this process.

    Raises
    ------
    InputError
        Reading took more memory or time than the options, or the file's size, allow; or the
        library that reads the file ended the child.
    """
    own = path.suffix.lower() in DECODED_HERE and not path.is_dir()
    if own or reads_here.is_set():
        return read(*args, **kwargs)
    limits = _Limits.of(path, options)
    answer = _ask((limits.time_s, read, args, kwargs), limits)
    if isinstance(answer, str):
        raise InputError(
            f"import {path}: {answer}; reading it may take {limits.memory_gb:.3g} GB of memory and "
            f"{limits.time_s:.0f} s (--reading-memory GB and --reading-time S allow more)"
        )
    for record in answer.log:
        logger = logging.getLogger(record.name)
        if logger.isEnabledFor(record.levelno):
            logger.handle(record)
    for warning in answer.warned:
        warnings.warn_explicit(*warning)
    if answer.error is not None:
        raise answer.error
    result: _T = answer.result
    return result


def _ask(request: object, limits: _Limits) -> _Answer | str:
    """Return a child's answer to a request, or why there is none."""
    done, over = threading.Event(), list[str]()
    environment = {**os.environ, "PYTHONPATH": import_path()}
    process = ChildProcess("-c", _PROGRAM, keeps_errors=True, env=environment)
    watch = threading.Thread(target=_watch, args=(process, limits, done, over), daemon=True)
    try:
        watch.start()
        answer: _Answer = process.ask(request)
        process.end(None)  # what its library has open is closed; the watch goes on
        return _more("memory") if isinstance(answer.error, MemoryError) else answer
    except EOFError:
        code = process.wait()
        return over[0] if over else _how_ended(code, process.close())
    finally:
        done.set()
        process.close()


def _watch(process: ChildProcess, limits: _Limits, done: threading.Event, over: list[str]) -> None:
    """End a process that exceeds a limit; `over` gets what the process did."""
    end_s = time.monotonic() + limits.time_s
    with suppress(psutil.Error):  # the process has ended
        child = psutil.Process(process.pid)
        while not over and not done.wait(_LOOK_S):
            if child.memory_info().rss > 1e9 * limits.memory_gb:
                over.append(_more("memory"))
            elif time.monotonic() > end_s:
                over.append(_more("time"))
    if over:
        process.kill()


def _more(what: str) -> str:
    return f"it took more {what} than it may"


def _how_ended(code: int, last_words: str) -> str:
    how = f"with code {code}"
    if code < 0 and sys.platform != "win32":
        how = f"by {signal.Signals(-code).name}"
    said = f" ({short_message(last_words)})" if last_words else ""
    return f"the library that reads it ended {how}{said}, as on a damaged file"


def main() -> None:
    """Read as the parent's request says, and send the answer."""
    parent = Parent()
    reads_here.set()
    time_s, read, args, kwargs = parent.receive()
    if sys.platform != "win32":
        signal.alarm(math.ceil(time_s) + 1)  # if the parent ends while a library holds the lock
    has_read = threading.Event()
    when_parent_ends(lambda: has_read.is_set() or os._exit(1))
    answer = _answer(read, args, kwargs)
    has_read.set()
    parent.send(answer)


def _answer(read: Callable[..., Any], args: Any, kwargs: Any) -> _Answer:
    log: SimpleQueue[logging.LogRecord] = SimpleQueue()
    logging.getLogger().addHandler(QueueHandler(log))
    error: Exception | None = None
    result = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            result = read(*args, **kwargs)
        except MmtError as raised:
            error = MemoryError() if isinstance(raised.__cause__, MemoryError) else raised
        except Exception:  # noqa: BLE001 - it is raised in the parent
            error = RuntimeError(traceback.format_exc())
    records = [log.get() for _ in range(log.qsize())]
    warned = [(str(w.message), w.category, w.filename, w.lineno) for w in caught]
    return _Answer(error, result, records, warned)
