"""The driver's side of the process that talks to the service."""

import time
from collections import Counter, deque
from typing import Final, Literal

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.core.running.process import ticks_in_real_time
from mmt.devices.driver_process import DriverProcess, text_of
from mmt_devices.inverse3 import exchange as to
from mmt_devices.inverse3.exchange import ABSENT, Inverse3State, ServiceAnswer
from mmt_devices.inverse3.options import InverseOptions

_READY_S: Final = 15.0
_FIRST_S: Final = 3.0
"""Longest time until the service lists its devices."""
_SLACK_MS: Final = 300.0
"""Added to `timeout_ms`, so that the process reports a silent service first."""
_KEPT: Final = 128
"""Number of states kept, 1/8 s."""
_SHORT_S: Final = 2e-5
_SHORT_AT_START_S: Final = 1e-3


class ServiceLink:
    """Process that talks to the service; only `start`, `await_answer` and `end` block.

    Parameters
    ----------
    role
        Role of the device.
    options
        Validated options of the driver.
    servo
        Arguments of the servo, apart from the device.
    counts
        Faults that the process survives are counted here.
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
        """Type and identifier of the device, and the service's address."""
        self.answers = 0
        """Number of the service's answers that were read."""
        self.state: ServiceAnswer | None = None
        """Newest answer, or None before the first."""
        self.kept: deque[Inverse3State] = deque(maxlen=_KEPT)
        """Newest plausible states, the oldest first."""
        self._problem = ""

    def start(self) -> None:
        """Start the process, and wait for the first answer of the service.

        Raises
        ------
        MmtError
            There is no usable service or device; the message says what to do.
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
            The device, the service or the process is gone or stuck.
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
        """Command a force (N) or a position (mm), in the device's axes."""
        self._process.send(to.COMMAND.pack(to.MOVE, time.monotonic_ns(), *numbers))

    def need_calibration(self) -> None:
        """From now on, let positions count as implausible if the device is not calibrated."""
        self._process.send(to.COMMAND.pack(to.CALIBRATED, time.monotonic_ns(), 0.0, 0.0, 0.0))

    def await_answer(self, longest_s: float) -> None:
        """Return soon after the service's next answer, or after `longest_s`."""
        self.poll()
        answers, deadline = self.answers, time.monotonic() + longest_s
        while self.answers == answers and time.monotonic() < deadline:
            time.sleep(_SHORT_S)
            self.poll()

    def end(self) -> None:
        """Take the force away and end the process; calling it twice is harmless.

        If the process has to be killed, the service gets no more messages and idles the device.
        """
        self._process.end(f"{self.name} is not connected: connect it first")

    def poll(self) -> None:
        """Take the messages that have arrived from the process."""
        for kind, body in self._process.receive():
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
