"""Replace a file only by one that is finished."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mmt.core.errors import InputError, MmtError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a file next to `path` to write to; it takes its place when the block ends well.

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
