"""Time-domain passivity: account for the energy at a port and never output more than was put in.

The passivity observer and controller of Hannaford and Ryu ("Time-domain passivity control of
haptic interfaces", IEEE Trans. Robot. Autom. 18 (2002)), at each end of a delayed two-port
(Ryu, Artigas and Preusche, "A passive bilateral control scheme for a teleoperator with
time-varying communication delay", Mechatronics 20 (2010)). Energy that flows in and energy
that flows out are counted separately. Both counts only grow, so that a count that comes late,
or not at all, can only make the other side more careful.

Discrete time: the force is held for a tick and the position is measured at its ends, so that
force times travel is the exact work, not an approximation of it. The travel that follows is not
known when a force is chosen. The force is therefore bounded by the remaining energy divided by
the farthest travel of the next tick (twice the last travel, plus what an acceleration of
`REACH_M_S2` adds). The port's net energy then never falls below minus the reserve; only a tick
whose travel goes beyond that reach can overdraw it, by the work of that one tick. If the force is
about to give energy out, half of the reserve is left, for a hand that turns round.

Each class is one axis of one port. Cost: 2 to 4 us a step in plain Python.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Final

from annotated_types import Ge, Gt

from mmt.core.bounds import check_fields

REACH_M_S2: Final = 100.0
"""Largest acceleration that is expected of a hand on its handle."""


@dataclass(frozen=True, slots=True)
class PassivitySettings:
    """Bounds of the controllers.

    Parameters
    ----------
    reserve_j
        Energy that a port may lend before anything was put in, above 0.
    damping_n_s_m
        Largest damping that the leader's controller adds: the limit of its dissipation rate.
    drift_m
        Farthest that the follower's command may be held back.
    tick_s
        Length of a tick.

    Raises
    ------
    InputError
        A value is out of range or not finite.
    """

    reserve_j: Annotated[float, Gt(0)] = 1e-3
    damping_n_s_m: Annotated[float, Ge(0)] = 10.0
    drift_m: Annotated[float, Ge(0)] = 3e-3
    tick_s: Annotated[float, Gt(0)] = 1e-3

    def __post_init__(self) -> None:
        check_fields(self)


class PassivityObserver:
    """Count the energy that flows in and out of a port, each of which only grows."""

    __slots__ = ("in_j", "out_j")

    def __init__(self) -> None:
        self.in_j = 0.0
        """Energy (J) that came in through the port."""
        self.out_j = 0.0
        """Energy (J) that went out through the port."""

    def add(self, work_j: float) -> None:
        """Count work; positive flows in."""
        if work_j > 0.0:
            self.in_j += work_j
        else:
            self.out_j -= work_j


class ForcePort:
    """The leader's port: a force is displayed on a handle that moves as the hand wants.

    The energy reference is the smaller of two counts: what the hand put in, and what the other
    side reports to have given back. The first alone makes the port passive whatever the other
    side does; the second keeps it from returning energy that a soft surface has dissipated.

    The controller is a damper on the handle, of at most the settings' damping, that dissipates
    the energy about to be missing. Then the force is bounded as described for the module.

    Parameters
    ----------
    settings
        Its bounds.
    opening_j
        Energy that the hand has put in before the account begins.
    """

    def __init__(self, settings: PassivitySettings, *, opening_j: float = 0.0) -> None:
        self._settings = settings
        self._observer = PassivityObserver()
        self._observer.in_j = opening_j
        self._slack_m = REACH_M_S2 * settings.tick_s**2
        self._position_m: float | None = None
        self._force_n = 0.0
        self._withheld_n = 0.0
        self.dissipated_j = 0.0
        """Work that the controller kept from the hand."""
        self.overdrawn_j = 0.0
        """Work of ticks whose travel went beyond the reach and the reserve; written off."""

    @property
    def in_j(self) -> float:
        """Energy (J) that the hand has put in."""
        return self._observer.in_j

    @property
    def out_j(self) -> float:
        """Energy (J) that the hand has received."""
        return self._observer.out_j + self.overdrawn_j

    def step(
        self, wanted_n: float, position_m: float, given_j: float = math.inf, ticks: int = 1
    ) -> float:
        """Return the force (N) to display until the next step, 0 at the first.

        Parameters
        ----------
        wanted_n
            The force on the handle, in the direction in which its position grows.
        position_m
            The handle's position.
        given_j
            Energy that the other side has given back so far; it must not fall.
        ticks
            Ticks since the last step, at least 1.
        """
        before_m = self._position_m
        if not math.isfinite(position_m):
            position_m = before_m or 0.0
        if not math.isfinite(wanted_n):
            wanted_n = 0.0
        self._position_m = position_m
        if before_m is None:
            return 0.0  # nothing is known of the hand's speed
        travel = position_m - before_m
        self._count(travel)
        left = min(self._observer.in_j, given_j) - self._observer.out_j
        period_s = ticks * self._settings.tick_s
        damping = self._damping(wanted_n, travel, left, period_s)
        force = wanted_n - damping * travel / period_s
        spare = max(0.0, left + self._settings.reserve_j)
        most = spare / (2.0 * abs(travel) + self._slack_m)
        self._force_n = max(-most, min(force, most))
        self._withheld_n = wanted_n - self._force_n
        return self._force_n

    def displayed(self, force_n: float) -> None:
        """Record that a force other than `step` returned, and no larger, was displayed."""
        self._withheld_n += self._force_n - force_n
        self._force_n = force_n

    def pause(self) -> None:
        """Stop displaying a force; the next step starts at a new position."""
        self._position_m = None
        self._force_n = self._withheld_n = 0.0

    def _count(self, travel: float) -> None:
        """Count the last tick's work."""
        self._observer.add(-self._force_n * travel)
        self.dissipated_j += max(0.0, self._withheld_n * travel)
        debt = self._observer.out_j - self._observer.in_j
        if debt > self._settings.reserve_j * (1.0 + 1e-9):
            self.overdrawn_j += debt
            self._observer.out_j -= debt

    def _damping(self, wanted_n: float, travel: float, left: float, period_s: float) -> float:
        """Return the damping (N s/m) that covers what the next tick would lack."""
        lacking = wanted_n * travel - left
        square = travel * travel
        if lacking <= 0.0 or square <= 0.0:
            return 0.0
        return min(self._settings.damping_n_s_m, lacking * period_s / square)


class MotionPort:
    """The follower's port: a command moves a robot that meets a force.

    Its controller holds the command back if the command would give the surface more energy than
    the leader has sent, and lets it catch up once that costs no energy or the energy has come.
    This makes first contact gentle. The command is held back no farther than the settings' drift,
    so that stability depends on the leader's port alone.
    """

    _QUIET_N: Final = 0.05
    """Forces below this are treated as sensor noise."""
    _CATCH_UP: Final = 0.02
    """Share of the drift that is caught up in a tick, if there is the energy for it."""
    _CATCH_UP_M_S: Final = 0.05
    """Largest speed of catching up."""

    def __init__(self, settings: PassivitySettings) -> None:
        self._settings = settings
        self._observer = PassivityObserver()
        self._wanted_m = 0.0
        self._command_m: float | None = None
        self._step_m = 0.0
        self._force_n = 0.0
        self.largest_drift_m = 0.0
        """Farthest that the command was held back."""

    @property
    def in_j(self) -> float:
        """Energy (J) that came back, at most what went out; the leader may pass it to the hand.

        A robot that follows with a lag can seem to return more than it got, from its motors.
        """
        return min(self._observer.in_j, self._observer.out_j)

    @property
    def out_j(self) -> float:
        """Energy (J) that went out to robot and surface."""
        return self._observer.out_j

    @property
    def drift_m(self) -> float:
        """How far the command is held back now."""
        return 0.0 if self._command_m is None else self._command_m - self._wanted_m

    def measure(self, force_n: float) -> None:
        """Record the force on the tool, the mean of the tick that followed the last command."""
        if not math.isfinite(force_n):
            force_n = 0.0
        self._force_n = force_n if abs(force_n) > self._QUIET_N else 0.0
        self._observer.add(self._force_n * self._step_m)
        self._step_m = 0.0

    def step(self, wanted_m: float, given_j: float) -> float:
        """Return the position (m) to command.

        Parameters
        ----------
        wanted_m
            The position that the leader asks for.
        given_j
            Energy that the leader has put in so far; it must not fall.
        """
        if not math.isfinite(wanted_m):
            wanted_m = self._wanted_m
        if self._command_m is None:
            self._command_m = self._wanted_m = wanted_m
            return wanted_m
        most = self._CATCH_UP_M_S * self._settings.tick_s
        caught_up = max(-most, min(self._CATCH_UP * self.drift_m, most))
        step = wanted_m - self._wanted_m - caught_up
        left = max(0.0, given_j + self._settings.reserve_j - self._observer.out_j)
        cost = -self._force_n * step
        if cost > left:
            step *= left / cost
        self._wanted_m = wanted_m
        drift = self._command_m + step - wanted_m
        drift = max(-self._settings.drift_m, min(drift, self._settings.drift_m))
        self._step_m += wanted_m + drift - self._command_m
        self._command_m = wanted_m + drift
        self.largest_drift_m = max(self.largest_drift_m, abs(drift))
        return self._command_m
