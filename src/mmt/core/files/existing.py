"""Write files and folders atomically, only where none exist unless told to, and measure them."""

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Final

from mmt.core.errors import InputError, MmtError, naming

_DEVICES: Final = Path("/dev")
_FULL: Final = {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}


def require_absent(path: Path, *, force: bool) -> None:
    """Refuse to write to a file or a ROS 2 bag that exists; with `force` it may be replaced.

    Raises
    ------
    InputError
        The file exists. Devices such as ``/dev/null`` may be written to.
    """
    if not force and (path.is_file() or (path / "metadata.yaml").is_file()):
        raise exists_error(path)


def exists_error(path: Path) -> InputError:
    """Return the error that says that a file exists, and what to do."""
    return InputError(f"{path}: it exists already; choose another name, or --force replaces it")


def free_path(path: Path) -> Path:
    """Return the first of `path`, ``NAME-2``, ``NAME-3``, ... that does not exist."""
    return next(each for each in numbered(path) if not each.exists())


def free_folder(folder: Path, *also: str) -> Path:
    """Return the first of `folder`, ``NAME-2``, ``NAME-3``, ... without recording or report.

    `also` names further files that the folder must not contain.
    """
    names = ("session.mcap", "report.html", *also)
    return next(
        each for each in numbered(folder) if not any((each / name).exists() for name in names)
    )


def numbered(path: Path) -> Iterator[Path]:
    """Yield `path`, then without end the path with 2, 3, ... after its stem."""
    yield path
    for number in count(2):
        yield with_number(path, str(number))


def with_number(path: Path, number: str) -> Path:
    """Return a path with a number after its stem.

    Raises
    ------
    InputError
        The path has no name, as ``.``.
    """
    if path.name in {"", ".."}:
        raise InputError(
            f"{path}: a number goes behind the name, and this is none; name a file or a folder"
        )
    return path.with_name(f"{path.stem}-{number}{path.suffix}")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a file next to `path` to write to; it replaces `path` if the block succeeds.

    A link stays and its target is replaced. A device or a pipe is written to directly.

    Raises
    ------
    InputError
        The folder does not exist or may not be written to.
    MmtError
        Writing failed, for instance because the disk is full; nothing is left behind.
    """
    if path.exists() and (path.parent == _DEVICES or not (path.is_file() or path.is_dir())):
        try:
            yield path
        except OSError as error:
            raise _failed(path, error) from error
        return
    whole = Path(os.path.realpath(path))
    part = whole.with_name(whole.name + ".part")
    try:
        part.touch()
    except OSError as error:
        raise write_error(path, error) from error
    try:
        yield part
        with part.open("rb+") as stream:
            os.fsync(stream.fileno())
        if whole.is_file():
            shutil.copymode(whole, part)
        part.replace(whole)
    except OSError as error:
        raise _failed(path, error) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a whole file, a text as UTF-8; make the folders above it.

    Every file that the product writes at once goes through this function or `replacing`, so
    that `path` always holds a complete file, the old or the new one.

    Raises
    ------
    InputError, MmtError
        See `replacing`.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_error(path, error) from error
    if isinstance(content, str):  # with a path, perhaps, whose bytes are no text
        content = content.encode("utf-8", "backslashreplace")
    with replacing(path) as part:
        part.write_bytes(content)


def append_lines(path: Path, text: str, *, header: str = "") -> None:
    """Write lines after a file's last, and wait until they are on the disk; all of them or none.

    Parameters
    ----------
    path
        Made, with the folders above it, if it does not exist.
    text
        Ends with a line break.
    header
        Written first if the file is empty.

    Raises
    ------
    OSError
        Writing failed; the file is as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+", buffering=0) as stream:
        length = stream.tell()
        stream.seek(max(0, length - 1))
        torn = stream.read() not in {b"", b"\n"}  # the last line, by an editor or a power cut
        content = memoryview(("\n" * torn + (text if length else header + text)).encode())
        try:
            while content:
                content = content[stream.write(content) :]
            os.fsync(stream.fileno())
        except OSError:
            with suppress(OSError):
                stream.truncate(length)
                if not length:
                    path.unlink()
            raise


def write_error(path: Path, error: OSError) -> MmtError:
    """Return the error of a failed write: `MmtError` if the disk is full, else `InputError`."""
    kind = MmtError if error.errno in _FULL else InputError
    return kind(f"cannot write {path}: {error.strerror or error}")


def _failed(path: Path, error: OSError) -> MmtError:
    return MmtError(f"writing {path} failed: {error.strerror or error}")


def size_bytes(path: Path) -> int:
    """Return the size of a file, or of all files in a folder; 0 if there is none."""
    files = [path, *(path.rglob("*") if path.is_dir() else ())]
    return sum(file.stat().st_size for file in files if file.is_file())


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """Yield the path of a folder to create; it replaces `path` when the block succeeds.

    The caller must have checked that an existing folder may be replaced.

    Raises
    ------
    InputError
        The parent folder of `path` does not exist or is not writable.
    MmtError
        Writing failed, for instance because the disk is full; a folder at `path` is kept, and
        nothing else is left behind.
    """
    with naming(f"cannot write {path}"):
        beside = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    made, before = beside / path.name, beside / f"{path.name}.before"
    try:
        yield made
        if path.is_dir():
            path.rename(before)
        try:
            made.rename(path)
        except OSError:
            if before.is_dir():
                before.rename(path)
            raise
    except OSError as error:
        raise _failed(path, error) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
