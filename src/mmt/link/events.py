"""What the two sides of the link tell the services that use them."""

from collections.abc import Callable
from dataclasses import dataclass

from mmt.core.arrays import RecordArray
from mmt.core.ranges import Range
from mmt.link.clock_offset import ClockJump
from mmt.link.log import LOG
from mmt.link.protocol import FollowerHello


def _nothing(*_: object) -> None:
    """Take note of nothing."""


def _no_ranges(_: int) -> list[Range]:
    """Miss nothing."""
    return []


def _log(error: Exception) -> None:
    LOG.error("an event of the link was not handled", exc_info=error)


@dataclass(frozen=True)
class LeaderEvents:
    """What the leader wants to be told; called on the loop, so they must return soon."""

    on_frames: Callable[[RecordArray, int], None]
    """Checked frames, shape (n,), read-only, in order; and their arrival, monotonic ns."""
    on_follower: Callable[[FollowerHello], None] = _nothing
    """A follower is about to be accepted; raising MmtError refuses it with that sentence."""
    on_end: Callable[[str], None] = _nothing
    """The follower ended the session, for this reason."""
    on_lost: Callable[[str], None] = _nothing
    """The follower went away without ending the session."""
    on_jump: Callable[[ClockJump], None] = _nothing
    """One of the two clocks has jumped against the other."""
    on_backfill: Callable[[RecordArray], None] = _nothing
    """Frames that were asked for, shape (n,), read-only, checked but for their numbers."""
    on_gone: Callable[[list[Range]], None] = _nothing
    """Frames that the follower has not got, or that cannot be used, by their numbers."""
    on_settle: Callable[[int], list[Range]] = _no_ranges
    """The follower is about to end and has sent the numbers below this one; return what is
    missing and is to be sent again."""
    on_error: Callable[[Exception], None] = _log
    """One of the above raised; by default the error is logged and the link goes on."""


@dataclass(frozen=True)
class FollowerEvents:
    """What the follower wants to be told; called on the loop, so they must return soon."""

    on_commands: Callable[[RecordArray, int], None]
    """Checked commands, shape (n,), read-only, newest last; and their arrival, monotonic ns."""
    on_session: Callable[[str], None] = _nothing
    """The leader's name of the session, which stands in its logs as well."""
    on_stop: Callable[[str], None] = _nothing
    """The leader asks to end the session, for this reason."""
    on_lost: Callable[[str], None] = _nothing
    """The link broke; it is taken up again as soon as the leader answers."""
    on_jump: Callable[[ClockJump], None] = _nothing
    """One of the two clocks has jumped against the other."""
    on_error: Callable[[Exception], None] = _log
    """One of the above raised; by default the error is logged and the link goes on."""


def call(
    function: Callable[..., None], *arguments: object, on_error: Callable[[Exception], None]
) -> None:
    """Call one of the events; python-socketio would but log what it raises."""
    try:
        function(*arguments)
    except Exception as error:  # noqa: BLE001 - handed to the service
        on_error(error)
