"""What the devices at the leader report: the state of a handle, the counts of an actuator."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from mmt.core.arrays import Vector


class InterfaceState(NamedTuple):
    """The leader's handle at one tick, known locally and therefore without delay."""

    position_mm: Vector
    """The handle's position, which is the follower's motion command."""
    velocity_mm_s: Vector
    """The handle's velocity."""
    force_n: float
    """The hand's own normal force on the surface, never negative."""
    contact: bool
    """Whether the hand presses on the surface."""

    @property
    def is_finite(self) -> bool:
        """Whether all of its numbers are finite."""
        return math.isfinite(sum(self.position_mm) + sum(self.velocity_mm_s) + self.force_n)


@dataclass(frozen=True, slots=True)
class ActuatorStatistics:
    """Counts and levels of the samples that an actuator was given."""

    samples: int
    clipped: int
    """Samples beyond the actuator's limit, written at the limit."""
    rms_m_s2: float
    """Root mean square of the samples after the limit."""
    peak_m_s2: float
    """Largest magnitude asked for, before the limit."""
