"""The force at the tool of an arm by Universal Robots, as the controller measures it."""

import logging
import math
import time
from collections import Counter
from collections.abc import Collection
from typing import Final

from mmt.core.arrays import Vector, difference
from mmt.core.errors import DeviceLost, MmtError
from mmt.core.extras import require
from mmt.devices.reading_checks import StuckCheck, measured
from mmt_devices.universal_robots.control import ZEROING_S
from mmt_devices.universal_robots.frame import SceneFrame
from mmt_devices.universal_robots.link import ArmLink
from mmt_devices.universal_robots.messages import UrState
from mmt_devices.universal_robots.options import ForceOptions

LOG: Final = logging.getLogger("mmt_devices.universal_robots")

_BIAS_S: Final = 0.2
_BIAS_STATES: Final = 20
_BIAS_PATIENCE_S: Final = 2.0
_UNREST_N: Final = 5.0
"""Largest spread of the values along an axis while the bias is taken."""
_CHANGE_S: Final = 0.5
_EDGE_S: Final = 0.05
"""Time about a program's start that is left out of the means before and after it."""
_SAID_N: Final = 1.0


class UrForceSensor:
    """Implements `ForceSensor`; see `docs/how-to/universal-robots.md`.

    The force is ``actual_TCP_force`` of RTDE: the external force on the tool in the base's axes,
    without the payload that is set at the controller. A tool that presses on a table under an
    upright arm measures a positive z. `read` subtracts the bias and rotates into the scene's axes.
    An e-Series arm zeroes its sensor whenever a program starts, as after a stop; the bias is then
    moved, so that the force goes on as before.
    """

    OPTIONS = ForceOptions

    def __init__(self, options: ForceOptions) -> None:
        self._options = options
        require("rtde_receive")
        self._frame = SceneFrame((0.0, 0.0, 0.0), self._options.rotation_rad)
        self._link: ArmLink | None = None
        self._bias_n: Vector | None = None
        self._program_ran: bool | None = None
        self._started: tuple[float, Vector | None] | None = None
        self._stuck = StuckCheck(1e6 * self._options.stuck_ms)

    def connect(self) -> None:
        """Connect to the arm, beside its robot.

        Raises
        ------
        InputError
            The robot of the same arm has its axes otherwise.
        MmtError
            The arm does not answer, or its force is stuck.
        """
        self.close()
        self._link = ArmLink(self._options, None, Counter())
        try:
            self._link.start()
            if self._stuck.is_stuck:
                self._await_change()
            self._program_ran = self._started = None
            if self._bias_n is not None:
                LOG.warning(
                    "the UR arm at %s is connected again: if its program has started meanwhile "
                    "with the tool pressed, the arm has zeroed its force sensor so, and the force "
                    "is wrong by that; then start again with the tool free",
                    self._options.host,
                )
        except BaseException:
            self.close()
            raise

    def _await_change(self) -> None:
        """Wait for a value other than the one at which it was stuck."""
        deadline = time.monotonic() + _CHANGE_S
        while not self._stuck.recovers([self._state().force_n]):
            if time.monotonic() > deadline:
                raise MmtError(self._explain_stuck())
            time.sleep(0.001)

    def calibrate(self) -> None:
        """Take the bias: the mean over 0.2 s.

        Raises
        ------
        MmtError
            The force varies meanwhile, or too few values arrive.
        """
        begun_s = time.monotonic()
        forces: dict[float, Vector] = {}
        while (passed_s := time.monotonic() - begun_s) < _BIAS_S or len(forces) < _BIAS_STATES:
            if passed_s > _BIAS_PATIENCE_S:
                raise MmtError(
                    f"{len(forces)} values of the force came from the UR arm in {passed_s:.1f} s "
                    "while the bias was taken: take load off this machine and its network"
                )
            state = self._state()
            if measured(state.force_n) is not None:
                forces[state.timestamp_s] = state.force_n
            time.sleep(0.001)
        columns = zip(*forces.values(), strict=True)
        if not all(n - min(column) <= _UNREST_N for column in columns for n in column):
            raise MmtError(
                "the force at the UR arm's tool moves while its bias is taken: keep the tool free "
                "and at rest"
            )
        self._bias_n = _mean(forces.values())

    def read(self) -> Vector:
        """Return the force (N) of the surface on the tool, of the newest cycle.

        Raises
        ------
        DeviceLost
            The arm does not answer any more, or its force is stuck.
        """
        state = self._state()
        if self._stuck.add(state.force_n, 1e9 * state.timestamp_s):
            raise DeviceLost(self._explain_stuck())
        self._follow_zero(state)
        (x, y, z), (u, v, w) = state.force_n, self._bias_n or (0.0, 0.0, 0.0)
        return self._frame.to_scene((x - u, y - v, z - w))

    def close(self) -> None:
        """Release the arm; calling it twice is harmless."""
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _follow_zero(self, state: UrState) -> None:
        """Move the bias by what a program's start has changed, once that is over."""
        now_s, ran, self._program_ran = state.timestamp_s, self._program_ran, state.program_runs
        if state.program_runs and ran is False:
            self._started = now_s, self._mean_n(now_s - ZEROING_S, now_s - _EDGE_S)
        if self._started is None or now_s < self._started[0] + ZEROING_S:
            return
        (began_s, before), self._started = self._started, None
        after = self._mean_n(began_s + _EDGE_S, now_s)
        if before is None or after is None:
            return
        x, y, z = difference(after, before)
        u, v, w = self._bias_n or (0.0, 0.0, 0.0)
        self._bias_n = (u + x, v + y, w + z)
        if math.hypot(x, y, z) > _SAID_N:
            LOG.warning(
                "the UR arm at %s has zeroed its force sensor at %.1f N, as its program started: "
                "the force goes on as before",
                self._options.host,
                math.hypot(x, y, z),
            )

    def _mean_n(self, begin_s: float, end_s: float) -> Vector | None:
        """Return the mean force (N) between two times of the controller, None if none came."""
        kept = () if self._link is None else self._link.kept
        within = [each.force_n for each in kept if begin_s <= each.timestamp_s <= end_s]
        forces = [force_n for force_n in within if measured(force_n) is not None]
        return _mean(forces) if forces else None

    def _state(self) -> UrState:
        if self._link is None:
            raise DeviceLost("the UR arm is not connected: connect it first")
        return self._link.read()

    def _explain_stuck(self) -> str:
        return (
            f"the force at the UR arm at {self._options.host} has had the very same values for "
            f"{self._options.stuck_ms:.0f} ms or more, which no sensor gives: check its sensor at "
            "the pendant; for a simulated controller set 'stuck_ms' to 0"
        )


def _mean(forces: Collection[Vector]) -> Vector:
    x, y, z = (sum(column) / len(forces) for column in zip(*forces, strict=True))
    return (x, y, z)
