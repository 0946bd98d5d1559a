"""The driver's end of the process that talks with the service."""

import time
from collections import Counter, deque
from typing import Final, Literal

from mmt.core.errors import DeviceLost, MmtError
from mmt.core.realtime import ticks_in_real_time
from mmt.devices.driver_process import DriverProcess, text_of
from mmt.devices.protocols import Vector
from mmt_devices.inverse3 import exchange as to
from mmt_devices.inverse3.exchange import ABSENT, Inverse3State, ServiceAnswer
from mmt_devices.inverse3.options import InverseOptions

_READY_S: Final = 15.0
_FIRST_S: Final = 3.0
"""How long the service may take to say which devices there are."""
_SLACK_MS: Final = 300.0
"""Longer than the process itself waits for the service."""
_KEPT: Final = 128
"""An eighth of a second."""
_SHORT_S: Final = 2e-5
_SHORT_AT_START_S: Final = 1e-3


class ServiceLink:
    """A process that talks with the service; nothing here waits but `start` and `end`.

    Parameters
    ----------
    role
        What the device is used as.
    options
        Of the driver, checked already.
    servo
        What its servo takes beside the device.
    counts
        What it survives is added here.
    """

    def __init__(
        self,
        role: Literal["handle", "robot"],
        options: InverseOptions,
        servo: dict[str, float],
        counts: Counter[str],
    ) -> None:
        self._address, self._timeout_ms = options.address, options.timeout_ms
        self._process = DriverProcess(
            "mmt_devices.inverse3.process",
            {
                "role": role,
                "address": options.address,
                "device": options.device,
                "commands": options.commands,
                "timeout_ms": options.timeout_ms,
                "first_s": _FIRST_S,
                "real_time": ticks_in_real_time(),
                "servo": servo,
            },
            f"the process that talks with {options.address} has ended: connect the device again",
            counts,
        )
        self.name = f"Inverse3 at {options.address}"
        """What the device says that it is, and where."""
        self.answers = 0
        """Answers of the service that were read."""
        self.state: ServiceAnswer | None = None
        """The newest one."""
        self.kept: deque[Inverse3State] = deque(maxlen=_KEPT)
        """The newest that make sense."""
        self._problem = ""

    def start(self) -> None:
        """Start the process, and wait for the first answer of the service.

        Raises
        ------
        MmtError
            There is no service, or none that can be used; the message says what to do.
        """
        self._process.start()
        deadline = time.monotonic() + _READY_S
        while self.state is None:
            if time.monotonic() > deadline:
                raise MmtError(f"the Haply Inverse Service at {self._address} does not get ready")
            time.sleep(_SHORT_AT_START_S)
            self.poll()
            if self._process.ended is not None:
                raise MmtError(self._process.ended)

    def read(self) -> ServiceAnswer:
        """Return the newest state.

        Raises
        ------
        DeviceLost
            The device, the service or the process has gone or is stuck.
        """
        self.poll()
        if self._process.ended is not None:
            raise DeviceLost(self._process.ended)
        if self._problem == ABSENT:
            raise DeviceLost(
                f"the service does not list {self.name} any more: check its cable and power"
            )
        if self._problem:
            raise DeviceLost(f"{self.name} has given {self._problem}")
        silent_ns = self._process.silent_ns
        if self.state is None or silent_ns > 1e6 * (self._timeout_ms + _SLACK_MS):
            raise DeviceLost(
                f"nothing has come from the process that talks with {self._address} for "
                f"{silent_ns / 1e6:.0f} ms: see whether this machine has time for it"
            )
        return self.state

    def move(self, numbers: Vector) -> None:
        """Command a force (N) or a place (mm), in the device's axes."""
        self._process.send(to.COMMAND.pack(to.MOVE, time.monotonic_ns(), *numbers))

    def need_calibration(self) -> None:
        """Have a position without calibration make no sense from now on."""
        self._process.send(to.COMMAND.pack(to.CALIBRATED, time.monotonic_ns(), 0.0, 0.0, 0.0))

    def await_answer(self, longest_s: float) -> None:
        """Return soon after the service's next answer."""
        self.poll()
        answers, deadline = self.answers, time.monotonic() + longest_s
        while self.answers == answers and time.monotonic() < deadline:
            time.sleep(_SHORT_S)
            self.poll()

    def end(self) -> None:
        """Take the force away and end the process; calling it twice is harmless.

        Where it must be killed, the service gets no messages and lets the device idle.
        """
        self._process.end(f"{self.name} is not connected: connect it first")

    def poll(self) -> None:
        """Take what has come."""
        for kind, body in self._process.take():
            if kind == to.STATE:
                self.state = state = to.unpack_state(body)
                self.answers += 1
                if state.measured is not None:
                    self.kept.append(state.measured)
            elif kind == to.FOUND:
                kind_of_device, _, device = text_of(body).partition("\n")
                self.name = f"{kind_of_device} {device} at {self._address}"
            elif kind == to.LOST:
                self._problem = text_of(body)
