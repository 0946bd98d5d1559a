"""Tip of an emulated Inverse3: a mass moved by forces, a hand and the service."""

import math
from collections.abc import Callable
from typing import Final

from mmt.core.arrays import Vector, difference

HeldAt = Callable[[Vector], Vector]
"""Returns where a hand holds the tip (mm) one millisecond later, given the force (N) it feels."""

MASS_KG: Final = 0.1
_DAMPING_N_S_M: Final = 0.5
_SERVICE_N_MM: Final = 2.0
"""Stiffness with which the service holds a position."""
_STEPS: Final = 2
"""Integration steps in a millisecond."""
_TICK_NS: Final = 1_000_000
_STEP_S: Final = 1e-3 / _STEPS
_COMMAND_NS: Final = 100_000_000
_LONGEST_NS: Final = 200_000_000
"""Longest time simulated at once; of a longer pause, the beginning is skipped."""
_ZERO: Final[Vector] = (0.0, 0.0, 0.0)


class EmulatedTip:
    """Mass of 100 g with a damping of 0.5 N s/m (our choice, typical of a small arm).

    Commands and `advance` simulate the tip up to their time. A command holds for 100 ms at most.

    Parameters
    ----------
    position_mm
        Initial position at rest, in the device's axes.
    held_at
        Hand that holds the tip by a critically damped spring; None for a free tip.
    """

    def __init__(self, position_mm: Vector, held_at: HeldAt | None = None) -> None:
        self.position_mm, self.velocity_mm_s = position_mm, _ZERO
        self.motor_n: Vector = _ZERO
        """Force of the motors: as commanded, or that of the service's spring."""
        self.braked = False
        """Whether the tip is held fast."""
        self.mode = "idle"
        self._held_at, self._hand_n_mm = held_at, 1.0
        self._hand_mm: Vector | None = None
        self._target_mm = _ZERO
        self._command_ns = 0
        self._moved_ns: int | None = None

    def hold(self, position_mm: Vector, stiffness_n_mm: float) -> None:
        """Hold the tip at a position by a spring."""
        self._held_at, self._hand_n_mm = (lambda _: position_mm), stiffness_n_mm

    def place(self, position_mm: Vector) -> None:
        """Put the tip at a position, at rest."""
        self.position_mm, self.velocity_mm_s = position_mm, _ZERO

    def command_force(self, force_n: Vector, now_ns: int) -> None:
        """Make the motors display a force."""
        self.advance(now_ns)
        self.mode, self.motor_n, self._command_ns = "force", force_n, now_ns

    def command_position(self, position_mm: Vector, now_ns: int) -> None:
        """Make the service hold the tip at a position."""
        self.advance(now_ns)
        self.mode, self._target_mm, self._command_ns = "position", position_mm, now_ns

    def advance(self, now_ns: int) -> None:
        """Simulate the tip up to a monotonic time."""
        if self._moved_ns is None:
            self._moved_ns = now_ns
        self._moved_ns = max(self._moved_ns, now_ns - _LONGEST_NS)
        while self._moved_ns + _TICK_NS <= now_ns:
            self._moved_ns += _TICK_NS
            if self._moved_ns - self._command_ns > _COMMAND_NS:
                self.mode, self.motor_n = "idle", _ZERO
            self._tick()

    def _tick(self) -> None:
        hand_mm_s = _ZERO
        if self._held_at is not None:
            before, self._hand_mm = self._hand_mm, self._held_at(self.motor_n)
            if before is not None:
                x, y, z = difference(self._hand_mm, before)
                hand_mm_s = (1e3 * x, 1e3 * y, 1e3 * z)
        if self.braked:
            return
        for _ in range(_STEPS):
            self._step(hand_mm_s)

    def _step(self, hand_mm_s: Vector) -> None:
        if self.mode == "position":
            self.motor_n = self._pull(self._target_mm, _ZERO, _SERVICE_N_MM)
        hand_n = _ZERO
        if self._hand_mm is not None:
            hand_n = self._pull(self._hand_mm, hand_mm_s, self._hand_n_mm)
        accelerations = (
            (motor + hand) / MASS_KG - _DAMPING_N_S_M / MASS_KG * 1e-3 * speed
            for motor, hand, speed in zip(self.motor_n, hand_n, self.velocity_mm_s, strict=True)
        )
        u, v, w = (
            speed + 1e3 * _STEP_S * acceleration
            for speed, acceleration in zip(self.velocity_mm_s, accelerations, strict=True)
        )
        x, y, z = self.position_mm
        self.velocity_mm_s = (u, v, w)
        self.position_mm = (x + _STEP_S * u, y + _STEP_S * v, z + _STEP_S * w)

    def _pull(self, place_mm: Vector, moving_mm_s: Vector, stiffness_n_mm: float) -> Vector:
        """Return the force of a critically damped spring."""
        damping_n_s_mm = 2e-3 * math.sqrt(1e3 * stiffness_n_mm * MASS_KG)
        x, y, z = difference(place_mm, self.position_mm)
        u, v, w = difference(moving_mm_s, self.velocity_mm_s)
        k, c = stiffness_n_mm, damping_n_s_mm
        return (k * x + c * u, k * y + c * v, k * z + c * w)
