"""Whether a follower that connects may be served."""

from collections.abc import Mapping, Sequence

from mmt.core.errors import InputError, MmtError
from mmt.core.frames import Channel
from mmt.link.access import REFUSED, Access
from mmt.link.protocol import FollowerHello


def admit(
    auth: object,
    occupant: FollowerHello | None,
    *,
    access: Access,
    channels: Sequence[Channel],
    rate_hz: int,
    extra: str = "",
) -> FollowerHello:
    """Return the hello of a follower that fits the leader's scene.

    Parameters
    ----------
    auth
        Of the connection, as anybody may have sent it.
    occupant
        Of the follower that is connected, None where none is. Its own process may take its
        place: it knows that its old connection is dead before the leader does.
    access
        What the leader asks for.
    channels, rate_hz
        What the leader's scene needs.
    extra
        The further event that the leader's scene has on the wire, empty for none.

    Raises
    ------
    MmtError
        It has not the leader's token; nothing else is told to it. Or it is the second.
    InputError
        It does not fit; the sentence is for the follower's user.
    """
    if not access.admits(auth.get("token") if isinstance(auth, Mapping) else None):
        raise MmtError(REFUSED)
    hello = FollowerHello.from_auth(auth)
    if occupant is not None and not (hello.run_id and hello.run_id == occupant.run_id):
        raise MmtError("another follower is connected: one leader serves one follower")
    if hello.rate_hz != rate_hz:
        raise InputError(
            f"the follower streams at {hello.rate_hz} Hz, the leader's scene expects "
            f"{rate_hz} Hz: use the same scene on both"
        )
    if hello.channels != tuple(channels):
        raise InputError(
            f"the follower sends {', '.join(hello.channels)}, the leader's scene needs "
            f"{', '.join(channels)}: use the same scene on both"
        )
    if hello.extra != extra:
        raise InputError(
            f"the follower has {hello.extra[:20] or 'nothing'} beside its frames, the leader's "
            f"scene {extra or 'nothing'} (method of [force_feedback]): use the same scene on both"
        )
    return hello
