"""Listening sockets, and the number of descriptors that a process may have."""

import errno
import socket
from collections.abc import Iterable
from typing import Any, Final

_WAITING: Final = 128
"""Connections that the system holds until they are accepted."""
_NO_SUCH_ADDRESS: Final = {errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT}
"""Errors to ignore: a host name may have an IPv6 address although the machine has no IPv6."""
_FEW: Final = 256
"""Number of descriptors to assume if the system sets no limit."""


def listening_sockets(addresses: Iterable[tuple[int, Any]]) -> list[socket.socket]:
    """Return a listening socket for each address (family, address) that this machine has.

    Raises
    ------
    OSError
        An address is in use or not permitted, or the machine has none of them.
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
