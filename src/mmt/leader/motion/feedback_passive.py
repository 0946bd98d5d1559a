"""The streamed force through time-domain passivity control, at the leader's port."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mmt.contact.energies import EnergyCounts, EnergyReport
from mmt.contact.passivity import PassivitySettings
from mmt.core.arrays import RecordArray
from mmt.core.frames import ENERGY, ENERGY_DTYPE
from mmt.core.guards import SILENCE_TICKS, ForceDisplay
from mmt.devices.leader_reports import InterfaceState
from mmt.leader.motion.feedback import StreamedForce
from mmt.leader.motion.passivity_ports import PassivityPorts


class PassiveForce(StreamedForce):
    """Display the newest streamed force as far as its energy is covered.

    The follower reports the energy returned to it (event `ENERGY`), and this side reports the
    energy that the hand has put in. About 15 us a tick.

    Parameters
    ----------
    interface, limit_n, silence_ticks
        As `StreamedForce`.
    settings
        Bounds of the controllers.
    opening_j
        Energy that each account begins with.
    """

    event: str | None = ENERGY
    dtype: "np.dtype[np.void] | None" = ENERGY_DTYPE

    def __init__(
        self,
        interface: ForceDisplay,
        *,
        limit_n: float,
        settings: PassivitySettings,
        silence_ticks: int = SILENCE_TICKS,
        opening_j: float = 0.0,
    ) -> None:
        super().__init__(interface, limit_n=limit_n, silence_ticks=silence_ticks)
        self._ports = PassivityPorts(settings, limit_n=limit_n, opening_j=opening_j)
        self._given = EnergyCounts(opening_j)
        self._report = EnergyReport()

    def on_records(self, records: RecordArray) -> None:
        """Take the energy that the follower reports as returned."""
        self._given.receive(records)

    def restart(self) -> None:
        """Prepare for a follower whose energy count may start again from zero."""
        self._given.restart()

    def tick(self, elapsed: int, state: InterfaceState | None) -> RecordArray | None:
        """Display the force for the elapsed ticks; return a report of energy, if one is due."""
        wanted = self._ramp.shape(self._force, elapsed)
        self._show(self._ports.step(wanted, state, elapsed, self._given.energy_j))
        return self._report.make(self._ports.in_j, elapsed)

    def pause(self, elapsed: int) -> None:
        """Display no force; see `StreamedForce`."""
        self._ports.pause()
        super().pause(elapsed)

    @property
    def summary(self) -> Mapping[str, Any]:
        """Energies (mJ), with the energy that the follower reports as returned."""
        return {
            **super().summary,
            "method": "passive",
            **self._ports.summary,
            "energy_given_mj": round(1e3 * sum(self._given.energy_j), 3),
        }
