"""The leader's passive port along three axes."""

import math
from collections.abc import Mapping
from typing import Any, Final

from mmt.contact.passivity import ForcePort, PassivitySettings
from mmt.core.arrays import Vector, bounded
from mmt.devices.leader_reports import InterfaceState

_M: Final = 1e-3
_UNLIMITED: Final[Vector] = (math.inf, math.inf, math.inf)


class PassivityPorts:
    """The leader's three ports, one for each axis.

    Parameters
    ----------
    settings
        Bounds of the controllers.
    limit_n
        Bound of the displayed force; its direction is kept.
    opening_j
        Energy that each account begins with, see `ForcePort`.
    """

    def __init__(
        self, settings: PassivitySettings, *, limit_n: float, opening_j: float = 0.0
    ) -> None:
        self._limit_n = limit_n
        self._ports = tuple(ForcePort(settings, opening_j=opening_j) for _ in range(3))
        self._opening_j = opening_j
        self._position: Vector | None = None
        self._injected_j = 0.0

    @property
    def in_j(self) -> Vector:
        """Energy (J) that the hand has put in, for each axis."""
        x, y, z = self._ports
        return (x.in_j, y.in_j, z.in_j)

    def pause(self) -> None:
        """Note that nothing is displayed; travel until the next step does no work."""
        self._position = None
        for port in self._ports:
            port.pause()

    def step(
        self,
        wanted_n: Vector,
        state: InterfaceState | None,
        elapsed: int,
        given_j: Vector = _UNLIMITED,
    ) -> Vector:
        """Return the force (N) to display; a handle that is not read is assumed to stand still."""
        if state is not None:
            self._position = state.position_mm
        if self._position is None:
            return (0.0, 0.0, 0.0)
        x, y, z = (
            port.step(wanted, _M * place, given, elapsed)
            for port, wanted, place, given in zip(
                self._ports, wanted_n, self._position, given_j, strict=True
            )
        )
        force = bounded((x, y, z), self._limit_n)
        for port, force_n in zip(self._ports, force, strict=True):
            port.displayed(force_n)
            self._injected_j = max(self._injected_j, port.out_j - port.in_j + self._opening_j)
        return force

    @property
    def summary(self) -> Mapping[str, Any]:
        """Energies (mJ) that were observed at the ports, and dissipated there."""
        ports = self._ports
        return {
            "energy_in_mj": round(1e3 * sum(port.in_j - self._opening_j for port in ports), 3),
            "energy_out_mj": round(1e3 * sum(port.out_j for port in ports), 3),
            "energy_injected_mj": round(1e3 * self._injected_j, 3),
            "energy_dissipated_mj": round(1e3 * sum(port.dissipated_j for port in ports), 3),
            "energy_overdrawn_mj": round(1e3 * sum(port.overdrawn_j for port in ports), 3),
        }
