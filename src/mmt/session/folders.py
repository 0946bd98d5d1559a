"""Write folders atomically, and measure them."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mmt.core.errors import InputError, MmtError


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
    try:
        beside = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error
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
        raise MmtError(f"writing {path} failed: {error.strerror or error}") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
