"""Force of a contact that another leader has modelled, rendered at this hand's position."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from mmt.contact.rendering import LocalContact
from mmt.core.arrays import RecordArray, Vector, bounded
from mmt.core.guards import ForceDisplay
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.motion.feedback_model import ModelSettings
from mmt.leader.motion.passivity_ports import PassivityPorts

if TYPE_CHECKING:
    from mmt_share.operator import OperatorClient

_M: Final = 1e-3
_SILENCE_TICKS: Final = 300
"""The contact comes 20 times a second; without it for this long, the force fades."""


class SharedContactForce(StreamedForce):
    """Display the force of the leader's contact model at this hand's own position.

    The force acts along the normal alone: friction is not modelled, and the streamed force is not
    shown, as its delay over a network could make it unstable. The force passes a `ForcePort`.

    Parameters
    ----------
    interface, limit_n
        As `StreamedForce`; no more is shown than the leader shows to its own hand.
    client
        Provides the contact while this hand has control.
    settings
        Settings of passivity and rendering.
    """

    def __init__(
        self,
        interface: ForceDisplay,
        client: "OperatorClient",
        *,
        limit_n: float,
        settings: ModelSettings,
    ) -> None:
        super().__init__(interface, limit_n=limit_n, silence_ticks=_SILENCE_TICKS)
        self._client = client
        self._ports = PassivityPorts(settings.passivity, limit_n=limit_n)
        self._contact = LocalContact(settings.rendering)
        self._heard = 0
        self._ramp.fall_silent()

    def tick(self, elapsed: int, state: InterfaceState | None) -> RecordArray | None:
        """Display the force for the elapsed ticks; nothing is sent."""
        client = self._client
        shared = client.contact
        if shared is None:
            self._ramp.fall_silent()
        else:
            if client.contacts != self._heard:
                self._heard = client.contacts
                self._contact.set_target(shared.model)
                self._ramp.renew()
            if state is not None:
                self._force = self._modelled(state, elapsed, shared.normal, shared.limit_n)
        wanted = self._ramp.shape(self._force, elapsed)
        self._show(self._ports.step(wanted, state, elapsed))
        return None

    def pause(self, elapsed: int) -> None:
        """Display nothing; see `StreamedForce`. The model stays."""
        self._ports.pause()
        self._contact.reset_position()
        super().pause(elapsed)

    def _modelled(self, state: InterfaceState, elapsed: int, normal: int, limit_n: float) -> Vector:
        depth_m = -_M * (state.position_mm[normal] + self.offset_mm[normal])
        force = [0.0, 0.0, 0.0]
        force[normal] = self._contact.step(depth_m, elapsed)
        return bounded((force[0], force[1], force[2]), min(limit_n, self._limit_n))

    @property
    def summary(self) -> Mapping[str, Any]:
        """Energies, and the largest force displayed."""
        return {**super().summary, "method": "shared", **self._ports.summary}
