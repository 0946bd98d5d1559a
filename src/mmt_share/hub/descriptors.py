"""Limit of open files, raised to what a hub's listeners need."""

from collections.abc import Callable
from typing import Final

from mmt.link.listening import descriptors

_SHARE: Final = 8
"""Files per listener: a server admits two connections for each listener, and uses a quarter of its
files for them; see `mmt.link.accepting.Acceptor`."""


def make_room(listeners: int, say: Callable[[str], None]) -> None:
    """Raise this process's limit of open files as far as possible, and say if it is too low.

    Parameters
    ----------
    listeners
        Number of listeners to serve at once.
    say
        Called with a sentence if the limit is too low.
    """
    try:
        import resource
    except ImportError:
        return  # Windows has no such limit
    needed = _SHARE * listeners
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    raised = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (raised, hard))
    if descriptors() < needed:
        say(
            f"{raised} files may be open, which is room for {raised // _SHARE} listeners and not "
            f"for {listeners}: raise the limit before the start (`ulimit -n {needed}`)"
        )
