"""The driver's end of the process that talks to an arm."""

import time
from collections import Counter, deque
from dataclasses import asdict
from typing import Final

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.driver_process import DriverProcess, text_of
from mmt.devices.protocols import Vector
from mmt_devices.universal_robots import messages as to
from mmt_devices.universal_robots.messages import UrState
from mmt_devices.universal_robots.servo import ServoSettings

_CONNECT_S: Final = 15.0
_SILENT_NS: Final = 700_000_000
_KEPT: Final = 64
"""An eighth of a second at 500 Hz."""
_SHORT_S: Final = 0.001
_NOT_CONTROLLED: Final = "the arm at {} is not controlled: connect the robot first"


class ArmLink:
    """A process that talks to an arm; nothing here waits but `start` and `end`.

    Parameters
    ----------
    host, frequency_hz
        Of the controller.
    servo
        How the arm is moved; None where it is read alone.
    counts
        What it survives is added here.

    Attributes
    ----------
    state
        The newest one.
    kept
        The newest ones.
    """

    def __init__(
        self, host: str, frequency_hz: float, servo: ServoSettings | None, counts: Counter[str]
    ) -> None:
        self._host, self._controls = host, servo is not None
        settings = None if servo is None else asdict(servo)
        self._process = DriverProcess(
            "mmt_devices.universal_robots.process",
            {"host": host, "frequency_hz": frequency_hz, "servo": settings},
            f"the process that talks to the UR arm at {host} has ended, as the library may when "
            "its connection breaks: check the arm's cable, and that it is switched on",
            counts,
        )
        self.state: UrState | None = None
        self.kept: deque[UrState] = deque(maxlen=_KEPT)
        self._refusal: str | None = _NOT_CONTROLLED.format(host)

    @property
    def refusal(self) -> str | None:
        """Why the arm takes no commands, None while it does."""
        return self._process.ended or self._refusal

    def start(self) -> None:
        """Start the process and wait until the arm answers, and is controlled where it shall be.

        Raises
        ------
        MmtError
            It does not; the message says what to check.
        """
        self._process.start()
        try:
            self._await()
        except BaseException:
            self.end()
            raise

    def _await(self) -> None:
        deadline = time.monotonic() + _CONNECT_S
        while self.state is None or (self._controls and self.refusal is not None):
            if time.monotonic() > deadline:
                raise MmtError(
                    f"the UR controller at {self._host} has not answered for {_CONNECT_S:g} s: "
                    "check 'host', its cable and that it is switched on"
                )
            time.sleep(_SHORT_S)
            self._poll()
            if self._process.ended is not None:
                raise MmtError(self._process.ended)

    def read(self) -> UrState:
        """Return the newest state.

        Raises
        ------
        DeviceLost
            None has come for a while, or the process ended.
        """
        self._poll()
        if self._process.ended is not None:
            raise DeviceLost(self._process.ended)
        silent_ns = self._process.silent_ns
        if silent_ns > _SILENT_NS:
            raise DeviceLost(
                f"nothing has come from the UR arm at {self._host} for {silent_ns / 1e6:.0f} ms: "
                "check its cable, and whether this machine has time for it"
            )
        if self.state is None:
            raise DeviceLost(f"nothing has come from the UR arm at {self._host} yet")
        return self.state

    def move(self, position_m: Vector) -> None:
        """Send the arm to a place of its base's frame (m)."""
        self._process.send(to.COMMAND.pack(to.MOVE, *position_m))

    def release(self) -> None:
        """Stop the arm and end its program; it is read on."""
        self._process.send(to.COMMAND.pack(to.RELEASE, 0.0, 0.0, 0.0))
        self._refusal = _NOT_CONTROLLED.format(self._host)

    def end(self) -> None:
        """Stop the arm and end the process; calling it twice is harmless.

        Where it must be killed, its connection ends, and the controller's watchdog stops the arm.
        """
        self._process.end(f"the UR arm at {self._host} is not connected")

    def _poll(self) -> None:
        """Take what has come."""
        for kind, body in self._process.take():
            if kind == to.STATE:
                self.state = to.unpack_state(body)
                self.kept.append(self.state)
            elif kind == to.CONTROLLED:
                self._refusal = None
            elif kind == to.LOST:
                self._refusal = text_of(body)
