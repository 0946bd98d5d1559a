"""Drivers of the Haply Inverse3, in a scene's axes: the follower's arm, the leader's handle."""

import atexit
import logging
import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final, Literal

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.axes import Axes
from mmt.devices.leader_reports import InterfaceState
from mmt_devices.inverse3.exchange import Inverse3State, ServiceAnswer
from mmt_devices.inverse3.link import ServiceLink
from mmt_devices.inverse3.options import HandleOptions, Inverse3RobotOptions, InverseOptions

LOG: Final = logging.getLogger("mmt_devices.inverse3")

_POLL_S: Final = 0.02
_CALIBRATE: Final = (
    "put its grip where it is calibrated (the inkwell; see Haply's quick start) until its light "
    "shows that it is"
)


class InverseDriver:
    """`Device` of an Inverse3; subclasses add `read` and `write`.

    Parameters
    ----------
    role
        Role of the device.
    options
        Validated options.
    **servo
        Further arguments of the role's servo.
    """

    def __init__(
        self, role: Literal["handle", "robot"], options: InverseOptions, **servo: float
    ) -> None:
        self._role, self._options = role, options
        self._servo = {"stale_ms": options.stale_ms, **servo}
        self._axes = Axes(options.axes, options.origin_mm)
        self._link: ServiceLink | None = None
        self._counts: Counter[str] = Counter()  # over all connections
        self._calibrated = False
        self.name = f"Inverse3 {options.device or ''}".rstrip() + f" at {options.address}"

    def connect(self) -> None:
        """Find the device; there is no force until the first command.

        Raises
        ------
        MmtError
            The service or the device is missing, or there are several and none is named.
        """
        self.close()
        link = ServiceLink(self._role, self._options, self._servo, self._counts)
        self._link = link
        try:
            link.start()
            self.name = link.name
            self._measured(link.read())
            if self._calibrated:  # connected again, perhaps after a loss of power
                self.calibrate()
        except BaseException:
            self.close()
            raise
        atexit.register(self.close)

    def calibrate(self) -> None:
        """Wait until the device is calibrated; the scene's zero is the option `origin_mm`.

        Raises
        ------
        MmtError
            The device is still not calibrated; the message says what to do.
        """
        link = self._connected()
        began, told = time.monotonic(), False
        while link.read().calibrated is False:
            if time.monotonic() - began > self._options.calibration_s:
                raise MmtError(f"{self.name} is not calibrated: {_CALIBRATE}")
            if not told:
                LOG.warning("%s is not calibrated: %s", self.name, _CALIBRATE)
                told = True
            time.sleep(_POLL_S)
        link.need_calibration()
        self._calibrated = True

    def close(self) -> None:
        """Take the force away and leave the service; calling it twice is harmless."""
        atexit.unregister(self.close)
        link, self._link = self._link, None
        if link is not None:
            link.close()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of survived faults, by kind."""
        if self._link is not None:
            self._link.receive()
        return dict(self._counts)

    def remarks(self) -> Sequence[str]:
        """Return a sentence for each doubt about the device's state."""
        state = None if self._link is None else self._link.state
        if state is None:
            return []
        doubtful = (
            (
                state.powered is False,
                "has no power supply and thus no force: plug it in",
            ),
            (state.used_elsewhere, "is used by another program as well: end that one"),
            (state.calibrated is False, f"is not calibrated: {_CALIBRATE}"),
        )
        return [f"{self.name} {remark}" for applies, remark in doubtful if applies]

    def _connected(self) -> ServiceLink:
        if self._link is None:
            raise DeviceLost(f"{self.name} is not connected: connect it first")
        return self._link

    def _measured(self, state: ServiceAnswer) -> Inverse3State:
        """Return the newest plausible state."""
        if state.measured is None:
            raise DeviceLost(
                f"{self.name} gives no position that makes sense: check its cable and calibration, "
                "and what the Haply Hub shows of it"
            )
        return state.measured

    def _command(self, numbers: Vector) -> None:
        """Command a force (N) or a position (mm), if finite, in the device's axes."""
        link = self._connected()
        link.read()
        if math.isfinite(sum(numbers)):
            link.move(numbers)
        else:
            self._counts["commands that are not finite"] += 1


_LONGEST_TURN_S: Final = 0.02


class Inverse3Robot(InverseDriver):
    """Implements `Robot`; see `docs/how-to/inverse3.md`."""

    OPTIONS = Inverse3RobotOptions

    def __init__(self, options: Inverse3RobotOptions) -> None:
        super().__init__(
            "robot",
            options,
            speed_limit_mm_s=options.speed_limit_mm_s,
            lead_limit_mm=options.lead_limit_mm,
        )

    def await_turn(self) -> None:
        """Return soon after the service's next answer, or after 20 ms."""
        self._connected().await_answer(_LONGEST_TURN_S)

    def read(self) -> Vector:
        """Return the tip's newest position (mm)."""
        return self._axes.place_in_scene(self._measured(self._connected().read()).position_mm)

    def positions(self, after_ns: int, until_ns: int) -> Sequence[tuple[int, Vector]]:
        """Return the newest positions (mm) that came between two times, the oldest first."""
        return [
            (measured.time_ns, self._axes.place_in_scene(measured.position_mm))
            for measured, *_ in tuple(self._connected().kept)
            if measured is not None and after_ns < measured.time_ns < until_ns
        ]

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm); count and ignore one that is not finite."""
        self._command(self._axes.place_on_device(position_mm))


class Inverse3Handle(InverseDriver):
    """Implements `LeaderInterface`; see `docs/how-to/inverse3.md`.

    An Inverse3 measures no force. With ``hand_force = "contact"`` in ``[handle]``, the leader
    infers the force from the motion.
    """

    OPTIONS = HandleOptions

    def __init__(self, options: HandleOptions) -> None:
        super().__init__("handle", options, ramp_ms=options.ramp_ms, limit_n=options.force_limit_n)

    def read(self, elapsed_ticks: int) -> InterfaceState:  # noqa: ARG002 - the device has a clock
        """Return the handle's newest state."""
        measured = self._measured(self._connected().read())
        position = self._axes.place_in_scene(measured.position_mm)
        velocity = self._axes.to_scene(measured.velocity_mm_s)
        return InterfaceState(position, velocity, 0.0, contact=False)

    def write(self, force_n: Vector) -> None:
        """Display a force (N), cut to the limit.

        A force that is not finite is counted and ignored.
        """
        self._command(self._axes.to_device(force_n))
