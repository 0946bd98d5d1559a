"""Folders that are written whole, or not at all."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mmt.core.errors import InputError, MmtError


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """Give a name of a folder to make; it takes the place of `path` when the block succeeds.

    Whether what is at `path` may be replaced, the caller has asked.

    Raises
    ------
    InputError
        The folder above `path` does not exist, or may not be written to.
    MmtError
        Writing failed, for instance because the disk is full; nothing is left behind, and what
        was at `path` stays.
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
            if before.is_dir():  # what was there stays
                before.rename(path)
            raise
    except OSError as error:
        raise MmtError(f"writing {path} failed: {error.strerror or error}") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
