"""Sockets that listen, and how many a process may have."""

import errno
import socket
from collections.abc import Iterable
from typing import Any, Final

_WAITING: Final = 128
"""Connections that the system holds until they are accepted."""
_NO_SUCH_ADDRESS: Final = {errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT}
"""A machine without IPv6 may still have a name with such an address, beside one that it has."""
_FEW: Final = 256
"""Descriptors that are counted on where the system has no limit of them."""


def listening_sockets(addresses: Iterable[tuple[int, Any]]) -> list[socket.socket]:
    """Return a socket that listens on each address, by family and address, that there is.

    Raises
    ------
    OSError
        One is taken, or may not be had, or there is none of them.
    """
    sockets: list[socket.socket] = []
    problem: OSError | None = None
    for family, address in addresses:
        try:
            listening = socket.create_server(address, family=family, backlog=_WAITING)
        except OSError as error:
            problem = error
            if error.errno not in _NO_SUCH_ADDRESS:
                break
        else:
            listening.setblocking(False)
            sockets.append(listening)
    if problem is not None and (not sockets or problem.errno not in _NO_SUCH_ADDRESS):
        for listening in sockets:
            listening.close()
        raise problem
    return sockets


def descriptors() -> int:
    """Return how many files and sockets this process may open."""
    try:
        import resource
    except ImportError:
        return _FEW  # Windows has no such limit
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return _FEW if soft == resource.RLIM_INFINITY else soft
