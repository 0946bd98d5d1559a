"""The leader's handle: a Phantom or Touch that the operator holds."""

import math
from typing import Any, Final

from mmt.devices.drivers import read_options
from mmt.devices.openhaptics.driver import HdDriver
from mmt.devices.openhaptics.library import Stack
from mmt.devices.openhaptics.options import HandleOptions
from mmt.devices.openhaptics.servo import Servo
from mmt.devices.protocols import InterfaceState, Vector

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


class OpenHapticsHandle(HdDriver[Servo]):
    """Implements `LeaderInterface`; the options are those of `HandleOptions`.

    `InterfaceState.force_n` is not measured but concluded: see `HandForce`, or with the option
    ``hand_force = "depth"`` a stiffness times the depth below the surface.

    Parameters
    ----------
    **options
        See `docs/how-to/openhaptics.md`.

    Raises
    ------
    InputError
        An option is not allowed.
    """

    def __init__(self, **options: Any) -> None:
        self._options = read_options(HandleOptions, "openhaptics", options)
        self._limit_n = self._options.force_limit_n
        self._hand = HandForce(self._options.apparent_mass_kg)
        super().__init__(self._options)

    def _make_servo(
        self,
        stack: Stack,
        handle: int,
        limit_n: float,
        stiffness_n_mm: float,  # noqa: ARG002 - nothing is rendered here
    ) -> Servo:
        self._limit_n = limit_n
        self._hand = HandForce(self._options.apparent_mass_kg)
        return Servo(
            stack.hd,
            stack.copies,
            handle,
            stale_ns=round(self._options.stale_ms * 1e6),
            ramp_ns=round(self._options.ramp_ms * 1e6),
        )

    def read(self, elapsed_ticks: int) -> InterfaceState:  # noqa: ARG002 - it has its own clock
        """Return the handle's newest state, at most a tick old.

        Raises
        ------
        DeviceLost
            It does not answer any more.
        """
        servo, options = self._device.check(), self._options
        position = self._axes.place_in_scene(servo.position)
        velocity = self._axes.to_scene(servo.velocity)
        if options.hand_force == "depth":
            force_n = max(-position[2], 0.0) * options.depth_stiffness_n_mm
        else:
            displayed = self._axes.to_scene(servo.displayed[:])
            force_n = self._hand.estimate(displayed[2], velocity[2], servo.tick_ns)
        return InterfaceState(position, velocity, force_n, force_n > options.contact_n)

    def write(self, force_n: Vector) -> None:
        """Display a force (N), cut to the limit; one that is not finite is counted and left out.

        Raises
        ------
        DeviceLost
            The handle does not answer any more.
        """
        servo = self._device.check()
        if not self._is_finite(servo, force_n):
            return
        x, y, z = force_n
        size = math.hypot(x, y, z)
        scale = 1.0 if size <= self._limit_n else self._limit_n / size
        servo.force = self._axes.to_device((scale * x, scale * y, scale * z))
        servo.command_ns = servo.clock()
