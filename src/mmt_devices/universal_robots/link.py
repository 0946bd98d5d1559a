"""The driver's side of the process that talks to an arm."""

from collections import Counter
from dataclasses import asdict
from threading import Lock
from typing import Final

from mmt.core.arrays import Vector
from mmt.core.errors import InputError
from mmt.devices.driver_process import DriverProcess
from mmt_devices.universal_robots.messages import UrState
from mmt_devices.universal_robots.options import UrOptions
from mmt_devices.universal_robots.servo import ServoSettings

_CONNECT_S: Final = 15.0
_SILENT_MS: Final = 700.0


class ArmLink(DriverProcess[UrState]):
    """Process that talks to an arm; only `start` and `close` block.

    Parameters
    ----------
    options
        Options of the driver.
    servo
        Settings for moving the arm; None if the arm is only read.
    counts
        Faults that the process survives are counted here.
    again
        Whether this session has moved the arm before.
    """

    def __init__(
        self,
        options: UrOptions,
        servo: ServoSettings | None,
        counts: Counter[str],
        *,
        again: bool = False,
    ) -> None:
        self._options, self._servo = options, servo
        self._host = host = options.host
        settings = None if servo is None else asdict(servo)
        super().__init__(
            "mmt_devices.universal_robots.process",
            {
                "host": host,
                "frequency_hz": options.frequency_hz,
                "servo": settings,
                "again": again,
            },
            f"the process that talks to the UR arm at {host} has ended, as the library may when "
            "its connection breaks: check the arm's cable, and that it is switched on",
            (
                f"nothing has come from the UR arm at {host}",
                "check its cable, and whether this machine has time for it",
                _SILENT_MS,
            ),
            counts,
        )

    def start(self) -> None:
        """Start the process; wait until the arm answers and, if it is to move, takes commands.

        Raises
        ------
        InputError
            Another driver of the same arm does not agree with this one.
        MmtError
            The arm does not answer or takes no commands; the message says what to check.
        """
        with _AGREEING:  # lost devices connect again in threads of their own
            for other in _STARTED:
                self._check_agreement(other)
            _STARTED.add(self)
        try:
            super().start()
            self.await_state(
                _CONNECT_S,
                f"the UR controller at {self._host} has not answered for {_CONNECT_S:g} s: check "
                "'host', its cable and that it is switched on",
            )
        except BaseException:
            self.close()
            raise

    def _check_agreement(self, other: "ArmLink") -> None:
        if other._host != self._host:
            return
        if self._servo is not None and other._servo is not None:
            raise InputError(
                f"the UR arm at {self._host} is the robot of two drivers: close one of them"
            )
        mine, theirs = self._options.rotation_rad, other._options.rotation_rad
        if mine != theirs:
            raise InputError(
                f"the UR arm at {self._host} is robot and force sensor: one has rotation_rad "
                f"{list(mine)}, the other {list(theirs)}; give both the same"
            )

    def move(self, position_m: Vector) -> None:
        """Send the arm to a position in its base's frame (m)."""
        self.send("move", position_m)

    def close(self) -> None:
        """Stop the arm and end the process; calling it twice is harmless.

        If the process is killed, its connection ends, and the controller's watchdog stops the arm.
        """
        self.end(f"the UR arm at {self._host} is not connected")
        with _AGREEING:
            _STARTED.discard(self)


_STARTED: Final[set[ArmLink]] = set()
_AGREEING: Final = Lock()
"""Links of this process that have been started and not ended."""
