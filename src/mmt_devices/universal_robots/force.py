"""The force at the tool of an arm by Universal Robots, as the controller measures it."""

import time
from collections import Counter
from typing import Any, Final

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.core.extras import require
from mmt.devices.drivers import read_options
from mmt_devices.universal_robots.frame import SceneFrame
from mmt_devices.universal_robots.link import ArmLink
from mmt_devices.universal_robots.messages import UrState
from mmt_devices.universal_robots.options import ForceOptions

_BIAS_S: Final = 0.2
_BIAS_STATES: Final = 20
_BIAS_PATIENCE_S: Final = 2.0
_UNREST_N: Final = 5.0
"""Largest spread of the values along an axis while the bias is taken."""
_CHANGE_S: Final = 0.5


class UrForceSensor:
    """Implements `ForceSensor`; the options are those of `ForceOptions`.

    The force is ``actual_TCP_force`` of RTDE: the external force on the tool in the base's axes,
    without the payload that is set at the controller. A tool that presses on a table under an
    upright arm measures a positive z. `read` subtracts the bias and rotates into the scene's axes.

    Parameters
    ----------
    **options
        See `docs/how-to/universal-robots.md`.

    Raises
    ------
    InputError
        An option is not allowed, or ur-rtde is not installed.
    """

    def __init__(self, **options: Any) -> None:
        self._options = read_options(ForceOptions, "ur", options)
        require("rtde_receive")
        self._frame = SceneFrame((0.0, 0.0, 0.0), self._options.rotation_rad)
        self._link: ArmLink | None = None
        self._bias_n: Vector = (0.0, 0.0, 0.0)
        self._last_n: Vector | None = None
        self._same_since_s = 0.0
        self._stuck = False

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
            if self._stuck:
                self._await_change()
        except BaseException:
            self.close()
            raise

    def _await_change(self) -> None:
        """Wait for a value other than the one at which it was stuck."""
        deadline = time.monotonic() + _CHANGE_S
        while self._state().force_n == self._last_n:
            if time.monotonic() > deadline:
                raise MmtError(self._explain_stuck())
            time.sleep(0.001)
        self._stuck, self._last_n = False, None

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
            forces[state.timestamp_s] = state.force_n
            time.sleep(0.001)
        columns = tuple(zip(*forces.values(), strict=True))
        if not all(n - min(column) <= _UNREST_N for column in columns for n in column):
            raise MmtError(
                "the force at the UR arm's tool moves while its bias is taken: keep the tool free "
                "and at rest"
            )
        x, y, z = (sum(column) / len(column) for column in columns)
        self._bias_n = (x, y, z)

    def read(self) -> Vector:
        """Return the force (N) of the surface on the tool, of the newest cycle.

        Raises
        ------
        DeviceLost
            The arm does not answer any more, or its force is stuck.
        """
        state = self._state()
        if state.force_n != self._last_n:
            self._last_n, self._same_since_s = state.force_n, state.timestamp_s
        elif 0.0 < self._options.stuck_ms <= 1e3 * (state.timestamp_s - self._same_since_s):
            self._stuck = True
            raise DeviceLost(self._explain_stuck())
        (x, y, z), (u, v, w) = state.force_n, self._bias_n
        return self._frame.to_scene((x - u, y - v, z - w))

    def close(self) -> None:
        """Release the arm; calling it twice is harmless."""
        link, self._link = self._link, None
        if link is not None:
            link.end()

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
