"""What a scene puts on its link, for either side; what it leaves out is not imported."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.scene import Scene

if TYPE_CHECKING:
    from mmt.link.extra import ExtraEvent
    from mmt.link.network import EmulatedNetwork


class ForceFeedbackSide(Protocol):
    """One side of a method of force feedback, as far as its event goes."""

    @property
    def event(self) -> str | None:
        """The further event, None where frames are enough."""

    @property
    def dtype(self) -> "np.dtype[np.void] | None":
        """Of that event's records."""

    def take_records(self, records: RecordArray) -> None:
        """Take checked records (n,) of the further event."""

    def restart(self) -> None:
        """Expect a new connection."""


def emulated_network(
    scene: Scene, direction: Literal["up", "down"], say: Callable[[str], None]
) -> "EmulatedNetwork | None":
    """Return the network that the scene emulates on this side, None for none."""
    if scene.network is None:
        return None
    from mmt.link.network import EmulatedNetwork

    return EmulatedNetwork(scene.network, direction, scene.session.seed, say)


def extra_event(feedback: ForceFeedbackSide | None) -> "ExtraEvent | None":
    """Return the event of a method of force feedback, None where it has none."""
    if feedback is None or feedback.event is None or feedback.dtype is None:
        return None
    from mmt.link.extra import ExtraEvent

    return ExtraEvent(feedback.event, feedback.dtype, feedback.take_records, feedback.restart)
