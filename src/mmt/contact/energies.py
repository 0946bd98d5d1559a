"""Exchange of port energies between leader and follower, robust to late, lost or reset counts."""

from typing import Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import ENERGY_DTYPE
from mmt.core.sequence_numbers import SEQUENCES

Energies = tuple[float, float, float]

_REPEAT_TICKS: Final = 100
"""Ticks after which the last report is repeated, in case it was lost."""


class EnergyCounts:
    """Energies that the other side reports for each axis of its port; they never decrease.

    The first report counts as zero: an earlier process of this side had that energy. A late report
    is smaller than the newest and is ignored. After `restart` a smaller one means that the other
    side started counting from zero; it is added to the earlier total.

    Parameters
    ----------
    opening_j
        Initial energy (J) of each axis, before the first report.
    """

    def __init__(self, opening_j: float = 0.0) -> None:
        self._base: Energies = (opening_j,) * 3
        self._newest: Energies = (0.0, 0.0, 0.0)
        self._begun = self._restarted = False

    @property
    def energy_j(self) -> Energies:
        """Energy (J) of each axis."""
        a, b = self._base, self._newest
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2])

    def receive(self, records: RecordArray) -> None:
        """Receive checked records (n,) of `ENERGY_DTYPE`, the newest last."""
        x, y, z = records["energy_j"][-1].tolist()
        newest: Energies = (max(0.0, x), max(0.0, y), max(0.0, z))
        old = self._newest
        if not self._begun:
            a, b, c = self._base
            self._base = (a - newest[0], b - newest[1], c - newest[2])
        self._begun = True
        if self._restarted and sum(newest) < sum(old):
            self._base = self.energy_j
            old = (0.0, 0.0, 0.0)
        self._restarted = False
        self._newest = (max(newest[0], old[0]), max(newest[1], old[1]), max(newest[2], old[2]))

    def restart(self) -> None:
        """Expect the next record from a new sender."""
        self._restarted = True


class EnergyReport:
    """Report of the energy put into this side's port, on every change and repeated at intervals."""

    def __init__(self) -> None:
        self._said: Energies = (0.0, 0.0, 0.0)
        self._quiet_ticks = 0
        self._sequence = 0

    def make(self, energy_j: Energies, elapsed: int, time_ns: int = 0) -> RecordArray | None:
        """Return the record (1,) to send now, or None."""
        self._quiet_ticks += elapsed
        if energy_j == self._said and (self._quiet_ticks < _REPEAT_TICKS or not any(energy_j)):
            return None
        self._said, self._quiet_ticks = energy_j, 0
        record = np.zeros(1, dtype=ENERGY_DTYPE)
        record[0] = (self._sequence, time_ns, energy_j)
        self._sequence = (self._sequence + 1) % SEQUENCES
        return record
