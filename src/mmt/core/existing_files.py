"""Files that exist already: none is replaced unless a person asks for it, and by a whole one."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from mmt.core.errors import InputError, MmtError


def require_absent(path: Path, *, force: bool) -> None:
    """Refuse to write to a file or a ROS 2 bag that exists; with `force` it may be replaced.

    Raises
    ------
    InputError
        It exists. Devices such as ``/dev/null`` may be written to.
    """
    if not force and (path.is_file() or (path / "metadata.yaml").is_file()):
        raise exists_error(path)


def exists_error(path: Path) -> InputError:
    """Return the error that says that a file exists, and what to do."""
    return InputError(f"{path}: it exists already; choose another name, or --force replaces it")


def free_path(path: Path) -> Path:
    """Return `path`, or where it exists the first of ``NAME-2``, ``NAME-3``, ... that does not."""
    return next(each for each in numbered(path) if not each.exists())


def numbered(path: Path) -> Iterator[Path]:
    """Give `path`, then the same with a number from 2 behind its stem, without end."""
    yield path
    for number in count(2):
        yield path.with_name(f"{path.stem}-{number}{path.suffix}")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a file next to `path` to write to; it replaces `path` when the block succeeds.

    Raises
    ------
    InputError
        The folder does not exist or may not be written to.
    MmtError
        Writing failed, for instance because the disk is full; nothing is left behind.
    """
    part = path.with_name(path.name + ".part")
    try:
        part.touch()
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise MmtError(f"writing {path} failed: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
