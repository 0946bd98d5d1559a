"""Kinesthetic feedback as in Awan et al., section IV: the streamed force goes to the hand."""

from collections.abc import Mapping
from math import hypot
from typing import TYPE_CHECKING, Any

import numpy as np

from mmt.core.arrays import RecordArray, Vector, bounded
from mmt.core.guards import SILENCE_TICKS, ForceDisplay, ForceRamp
from mmt.devices.leader_reports import InterfaceState

if TYPE_CHECKING:
    from mmt.contact.estimation import ContactModel


class StreamedForce:
    """Write the newest streamed force to the leader's interface once a tick.

    The other methods, which display another force or a part of it, are derived from this one.

    Parameters
    ----------
    interface
        The operator's handle.
    limit_n
        Bound of the displayed force; its direction is kept.
    silence_ticks
        Ticks without a frame after which the force fades to zero over as many; when frames
        come again it returns over as many.
    """

    event: str | None = None
    dtype: "np.dtype[np.void] | None" = None
    offset_mm: Vector = (0.0, 0.0, 0.0)
    """The follower's command minus the hand's position."""

    def __init__(
        self, interface: ForceDisplay, *, limit_n: float, silence_ticks: int = SILENCE_TICKS
    ) -> None:
        self._interface = interface
        self._limit_n = limit_n
        self._ramp = ForceRamp(silence_ticks, silence_ticks)
        self._force: Vector = (0.0, 0.0, 0.0)
        self._largest_n = 0.0

    def on_frames(self, frames: RecordArray) -> None:
        """Store the force of frames (n,), n >= 1, the newest last."""
        self._force = bounded(frames["force_n"][-1].tolist(), self._limit_n)
        self._ramp.renew()

    def on_records(self, records: RecordArray) -> None:
        """Do nothing: there is no further event."""

    def restart(self) -> None:
        """Do nothing: the newest force is displayed, whichever follower sent it."""

    def tick(
        self,
        elapsed: int,
        state: InterfaceState | None,  # noqa: ARG002 - the force does not depend on it
    ) -> RecordArray | None:
        """Display the force for the elapsed ticks.

        Parameters
        ----------
        elapsed
            Ticks since the last call, at least 1.
        state
            State of the handle, or None if it is not read.

        Returns
        -------
        records
            Shape (1,), to send to the follower as the same event; None if nothing is sent.
        """
        self._show(self._ramp.shape(self._force, elapsed))
        return None

    def pause(self, elapsed: int) -> None:
        """Display no force for the elapsed ticks, in place of `tick`: the handle is lost.

        Afterwards the force returns from zero, wherever the handle then is.
        """
        self._ramp.pause(elapsed)
        self._show((0.0, 0.0, 0.0))

    @property
    def contact_model(self) -> "ContactModel | None":
        """The model of the contact that the hand feels, or None if it feels none."""
        return None

    @property
    def summary(self) -> Mapping[str, Any]:
        """Name of the method, the largest force displayed (N), and other figures so far."""
        return {"method": "streamed", "largest_n": round(self._largest_n, 3)}

    def _show(self, force_n: Vector) -> None:
        self._largest_n = max(self._largest_n, hypot(*force_n))
        self._interface.write(force_n)
