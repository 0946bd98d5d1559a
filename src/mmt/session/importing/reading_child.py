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
import pickle
import signal
import subprocess
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
from tempfile import TemporaryFile
from typing import IO, Any, Final, NamedTuple, ParamSpec, TypeVar

import psutil

from mmt.core.errors import InputError, MmtError, short_message
from mmt.core.running.programs import handle_end_signals, import_path, python_command
from mmt.session.folders import size_bytes
from mmt.session.importing.options import ImportOptions

DECODED_HERE: Final = (".csv", ".txt", ".tsv", ".dat", ".lvm", ".npy", ".npz", ".wav")

_MEMORY_GB: Final = 2.0
_MEMORY_PER_BYTE: Final = 16
"""Parquet takes 6 times its size, other formats less; a recording rarely packs much better."""
_TIME_S: Final = 60.0
_TIME_S_PER_MB: Final = 5.0
"""Workbooks take 2 s/MB on two busy cores, bags of short messages 0.7, other formats 0.03."""
_LOOK_S: Final = 0.01
_SHOWN_BYTES: Final = 1000

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
    with TemporaryFile() as printed:
        process = subprocess.Popen(  # noqa: S603 - our own module
            python_command("-c", _PROGRAM),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=printed,
            env={**os.environ, "PYTHONPATH": import_path()},
            start_new_session=sys.platform != "win32",  # Ctrl-C reaches this process alone
        )
        watch = threading.Thread(target=_watch, args=(process, limits, done, over), daemon=True)
        try:
            with process:
                watch.start()
                assert process.stdin is not None  # noqa: S101 - it was asked for
                assert process.stdout is not None  # noqa: S101 - it was asked for
                pickle.dump(request, process.stdin)
                process.stdin.flush()
                answer: _Answer = pickle.load(process.stdout)  # noqa: S301 - from our own child
            return _more("memory") if isinstance(answer.error, MemoryError) else answer
        except (EOFError, OSError, pickle.UnpicklingError):
            return over[0] if over else _how_ended(process.wait(), printed)
        finally:
            done.set()
            process.kill()
            process.wait()


def _watch(
    process: "subprocess.Popen[bytes]", limits: _Limits, done: threading.Event, over: list[str]
) -> None:
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


def _how_ended(code: int, printed: IO[bytes]) -> str:
    how = f"with code {code}"
    if code < 0 and sys.platform != "win32":
        how = f"by {signal.Signals(-code).name}"
    printed.seek(max(0, printed.seek(0, os.SEEK_END) - _SHOWN_BYTES))
    last = printed.read().decode(errors="replace").strip().rpartition("\n")[2]
    said = f" ({short_message(last)})" if last else ""
    return f"the library that reads it ended {how}{said}, as on a damaged file"


def main() -> None:
    """Read as the request at standard input says, and write the answer to standard output."""
    handle_end_signals(signal.SIG_IGN)  # the parent says when this ends
    reads_here.set()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # printed text must not mix with the answer
    time_s, read, args, kwargs = pickle.load(sys.stdin.buffer)  # noqa: S301 - from the parent
    if sys.platform != "win32":
        signal.alarm(math.ceil(time_s) + 1)  # if the parent ends while a library holds the lock
    has_read = threading.Event()
    threading.Thread(target=_end_with_parent, args=(has_read,), daemon=True).start()
    answer = _answer(read, args, kwargs)
    has_read.set()
    pickle.dump(answer, answers, pickle.HIGHEST_PROTOCOL)
    answers.close()


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


def _end_with_parent(has_read: threading.Event) -> None:
    """End this process when its input is closed, which the system does however the parent ends."""
    while os.read(0, 1):
        pass
    if not has_read.is_set():
        os._exit(1)
