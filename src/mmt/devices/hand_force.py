"""How hard a hand presses on a handle that has no force sensor."""

from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

_SMOOTHING_S: Final = 0.01
"""Time constant of the acceleration, which is a difference of velocities."""


class HandForce:
    """How hard the hand presses, from what the handle displays and how it moves.

    A handle of this kind has no force sensor. On its mass m act the displayed force F and
    the hand's; its own friction and weight are left out, so that along the normal the hand
    presses with F - m a. With m = 0 that is the displayed force, right while the hand is
    slow. Cost: under a microsecond.

    Parameters
    ----------
    mass_kg
        Apparent mass of the handle along the normal.
    """

    def __init__(self, mass_kg: float) -> None:
        self._mass = mass_kg
        self._time_ns: int | None = None
        self._velocity = self._acceleration = 0.0

    def estimate(self, displayed_n: float, velocity_mm_s: float, time_ns: int) -> float:
        """Return the hand's pressing force (N), never negative.

        Parameters
        ----------
        displayed_n, velocity_mm_s
            Along the normal, away from the surface.
        time_ns
            When they were measured; one that has not moved on changes nothing.
        """
        if self._mass == 0.0:
            return max(displayed_n, 0.0)
        if self._time_ns is None:
            self._time_ns, self._velocity = time_ns, velocity_mm_s
        elif time_ns > self._time_ns:
            passed_s = 1e-9 * (time_ns - self._time_ns)
            fresh = 1e-3 * (velocity_mm_s - self._velocity) / passed_s
            share = passed_s / (passed_s + _SMOOTHING_S)
            self._acceleration += share * (fresh - self._acceleration)
            self._time_ns, self._velocity = time_ns, velocity_mm_s
        return max(displayed_n - self._mass * self._acceleration, 0.0)


class HandForceOptions(BaseModel):
    """Options of such a handle: how the hand's normal force is known."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    hand_force: Literal["displayed", "depth"] = "displayed"
    apparent_mass_kg: float = Field(0.0, ge=0, le=1)
    depth_stiffness_n_mm: float = Field(0.5, gt=0, le=50)
    contact_n: float = Field(0.05, ge=0.001, le=1)
