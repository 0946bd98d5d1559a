"""The follower's side of force feedback, if the scene's method has one."""

from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import numpy as np

from mmt.contact.energies import EnergyCounts, EnergyReport
from mmt.contact.passivity import MotionPort, PassivitySettings
from mmt.core.arrays import RecordArray, Vector
from mmt.core.frames import (
    CONTACT,
    CONTACT_DTYPE,
    CONTACT_GATHERED,
    ENERGY,
    ENERGY_DTYPE,
)
from mmt.scene import Scene

_M: Final = 1e-3


class PassiveFollower:
    """Hold back commands that would give a surface more energy than the leader has sent.

    About 15 us a tick.

    Parameters
    ----------
    settings
        Bounds of the controllers.
    """

    event: str = ENERGY
    dtype: "np.dtype[np.void]" = ENERGY_DTYPE

    def __init__(self, settings: PassivitySettings) -> None:
        self._ports = tuple(MotionPort(settings) for _ in range(3))
        self._given = EnergyCounts()
        self._report = EnergyReport()

    def command(self, position_mm: Vector | None) -> Vector | None:
        """Return the position (mm) that the robot is to take: as far as the energy allows."""
        if position_mm is None:
            return None
        x, y, z = (
            port.step(_M * wanted, given) / _M
            for port, wanted, given in zip(
                self._ports, position_mm, self._given.energy_j, strict=True
            )
        )
        return (x, y, z)

    def measured(self, frames: RecordArray) -> RecordArray | None:
        """Count the work of frames (n,), n >= 1, that followed the command.

        Returns a report of returned energy to send, if one is due.
        """
        force = frames["force_n"].mean(axis=0).tolist()
        for port, force_n in zip(self._ports, force, strict=True):
            port.measure(force_n)
        x, y, z = self._ports
        return self._report.make((x.in_j, y.in_j, z.in_j), len(frames), int(frames["time_ns"][-1]))

    def on_records(self, records: RecordArray) -> None:
        """Take the energy that the hand has put in."""
        self._given.receive(records)

    def restart(self) -> None:
        """Prepare for a leader whose energy count may start again from zero."""
        self._given.restart()

    @property
    def summary(self) -> Mapping[str, Any]:
        """Energies (mJ), and how far the command was held back."""
        ports = self._ports
        return {
            "method": "passive",
            "energy_out_mj": round(1e3 * sum(port.out_j for port in ports), 3),
            "energy_in_mj": round(1e3 * sum(port.in_j for port in ports), 3),
            "energy_given_mj": round(1e3 * sum(self._given.energy_j), 3),
            "largest_drift_mm": round(1e3 * max(port.largest_drift_m for port in ports), 3),
        }


class ContactReporter:
    """Report the command, the tool's position and the force of every tick to the leader."""

    event: str = CONTACT
    dtype: "np.dtype[np.void]" = CONTACT_DTYPE

    def __init__(self) -> None:
        self._command: Vector | None = None
        self._gathered: list[RecordArray] = []
        self._samples = 0

    def command(self, position_mm: Vector | None) -> Vector | None:
        """Note the command, and return it unchanged."""
        self._command = position_mm
        return position_mm

    def measured(self, frames: RecordArray) -> RecordArray | None:
        """Return the samples (n,) to send once enough are gathered, else None."""
        if self._command is None:
            return None
        records = np.zeros(len(frames), dtype=CONTACT_DTYPE)
        for name in ("sequence", "time_ns", "position_mm", "force_n"):
            records[name] = frames[name]
        records["command_mm"] = self._command
        self._samples += len(frames)
        self._gathered.append(records)
        if sum(map(len, self._gathered)) < CONTACT_GATHERED:
            return None
        block = np.concatenate(self._gathered)
        self._gathered.clear()
        return block

    def on_records(self, records: RecordArray) -> None:
        """Do nothing: the leader sends no such records."""

    def restart(self) -> None:
        """Do nothing: samples do not depend on earlier ones."""

    @property
    def summary(self) -> Mapping[str, Any]:
        """How many samples were made."""
        return {"method": "model", "samples": self._samples}


FollowerFeedback: TypeAlias = PassiveFollower | ContactReporter
"""The follower's side of force feedback, called in each tick."""


def build_feedback(scene: Scene) -> FollowerFeedback | None:
    """Return the follower's side of force feedback or of the hand's force, or None."""
    table = scene.force_feedback
    if table is not None and table.method == "passive":
        return PassiveFollower(
            PassivitySettings(
                reserve_j=1e-3 * table.reserve_mj,
                drift_m=_M * table.largest_drift_mm,
                tick_s=1.0 / scene.session.rate_hz,
            )
        )
    return ContactReporter() if scene.reports_contact else None
