"""The driver's side of the process that talks to the service."""

import time
from collections import Counter
from typing import Any, Final, Literal

from mmt.core.arrays import Vector
from mmt.core.running.process import ticks_in_real_time
from mmt.devices.driver_process import LOST, DriverProcess
from mmt_devices.inverse3 import exchange as to
from mmt_devices.inverse3.exchange import ABSENT, ServiceAnswer
from mmt_devices.inverse3.options import InverseOptions

_READY_S: Final = 15.0
_FIRST_S: Final = 3.0
"""Longest time until the service lists its devices."""
_SLACK_MS: Final = 300.0
"""Added to `timeout_ms`, so that the process reports a silent service first."""
_SHORT_S: Final = 2e-5


class ServiceLink(DriverProcess[ServiceAnswer]):
    """Process that talks to the service; only `start`, `await_answer` and `close` block.

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
        self._address = options.address
        super().__init__(
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
            (
                f"nothing has come from the process that talks with {options.address}",
                "see whether this machine has time for it",
                options.timeout_ms + _SLACK_MS,
            ),
            counts,
        )
        self.name = f"Inverse3 at {options.address}"
        """Type and identifier of the device, and the service's address."""

    def start(self) -> None:
        """Start the process, and wait for the first answer of the service.

        Raises
        ------
        MmtError
            There is no usable service or device; the message says what to do.
        """
        super().start()
        late = f"the Haply Inverse Service at {self._address} does not get ready"
        self.await_state(_READY_S, late)

    def move(self, numbers: Vector) -> None:
        """Command a force (N) or a position (mm), in the device's axes."""
        self.send(to.MOVE, time.monotonic_ns(), numbers)

    def need_calibration(self) -> None:
        """From now on, let positions count as implausible if the device is not calibrated."""
        self.send(to.CALIBRATED)

    def await_answer(self, longest_s: float) -> None:
        """Return soon after the service's next answer, or after `longest_s`."""
        self.receive()
        state, deadline = self.state, time.monotonic() + longest_s
        while self.state is state and time.monotonic() < deadline:
            time.sleep(_SHORT_S)
            self.receive()

    def close(self) -> None:
        """Take the force away and end the process; calling it twice is harmless.

        If the process has to be killed, the service gets no more messages and idles the device.
        """
        self.end(f"{self.name} is not connected: connect it first")

    def keep(self, kind: str, body: Any) -> None:
        """Keep what a message says; see `DriverProcess`."""
        if kind == to.FOUND:
            self.name = f"{body} at {self._address}"
        elif kind == LOST and body == ABSENT:
            body = f"the service does not list {self.name} any more: check its cable and power"
        elif kind == LOST:
            body = f"{self.name} has given {body}"
        super().keep(kind, body)
