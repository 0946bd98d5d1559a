"""One writer a file, where the system can tell."""

import errno
import importlib
from importlib.util import find_spec
from typing import Any, BinaryIO, Final

fcntl: Final[Any] = importlib.import_module("fcntl") if find_spec("fcntl") else None
"""None on Windows, whose own rules for open files apply."""


def lock(stream: BinaryIO) -> bool:
    """Claim an open file until it is closed; False where another process has it.

    A file system that knows no locks, as some on a network, lets everyone pass.
    """
    if fcntl is None:
        return True
    try:
        fcntl.flock(stream.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in {errno.EWOULDBLOCK, errno.EACCES}
    return True
