"""Base of the drivers of robot and handle: one Inverse3, in a scene's axes."""

import atexit
import logging
import math
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.axes import Axes
from mmt_devices.inverse3.exchange import Inverse3State, ServiceAnswer
from mmt_devices.inverse3.link import ServiceLink
from mmt_devices.inverse3.options import InverseOptions

LOG: Final = logging.getLogger("mmt_devices.inverse3")

_POLL_S: Final = 0.02
_CALIBRATE: Final = (
    "put its grip where it is calibrated (the inkwell; see Haply's quick start) until its light "
    "shows that it is"
)


class InverseDriver(ABC):
    """`Device` of an Inverse3; subclasses make the link and add `read` and `write`.

    Parameters
    ----------
    options
        Validated options.
    """

    def __init__(self, options: InverseOptions) -> None:
        self._options = options
        self._axes = Axes(options.axes, options.origin_mm)
        self._link: ServiceLink | None = None
        self._counts: Counter[str] = Counter()  # over all connections
        self._calibrated = False
        self.name = f"Inverse3 {options.device or ''}".rstrip() + f" at {options.address}"

    @abstractmethod
    def _make_link(self) -> ServiceLink:
        """Make the link of a new connection."""

    def connect(self) -> None:
        """Find the device; there is no force until the first command.

        Raises
        ------
        MmtError
            The service or the device is missing, or there are several and none is named.
        """
        self.close()
        self._link = link = self._make_link()
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
            link.end()

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of survived faults, by kind."""
        if self._link is not None:
            self._link.poll()
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
        """Command a force (N) or a position (mm), if finite, in the device's axes.

        Raises
        ------
        DeviceLost
            The device does not answer any more.
        """
        link = self._connected()
        link.read()
        if math.isfinite(sum(numbers)):
            link.move(numbers)
        else:
            self._counts["commands that are not finite"] += 1
