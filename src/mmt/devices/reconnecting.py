"""Connect a lost device again, and say why that does not work yet."""

import re
import threading
from typing import Final

from mmt.devices.protocols import Device

_RETRY_S: Final = 0.5
_LONGEST_RETRY_S: Final = 3.0
_BACK_OFF: Final = 1.5
"""Each pause before the next try is so much longer: a device that is away for an hour is not asked
twice a second, and one that was plugged in again is there within three seconds."""
_MOST_REASONS: Final = 5
"""Told of one loss."""


class Reconnection(threading.Thread):
    """Close and connect a device until that works, beside the ticks, since it may take long."""

    def __init__(self, device: Device, reason: str = "") -> None:
        super().__init__(name=f"connect {type(device).__name__}", daemon=True)
        self._device = device
        self._given_up = threading.Event()
        self.done = threading.Event()
        self.reason = reason
        """Why it did not work the last time, before the first why it was lost."""
        self.start()

    def run(self) -> None:
        """Try until it works or is given up."""
        pause_s = _RETRY_S
        while not self._given_up.is_set():
            try:
                self._device.close()
                self._device.connect()
            except Exception as error:  # noqa: BLE001 - whatever a driver raises, try again
                self.reason = str(error) or type(error).__name__
                self._given_up.wait(pause_s)
                pause_s = min(_BACK_OFF * pause_s, _LONGEST_RETRY_S)
            else:
                self.done.set()
                return

    def give_up(self) -> None:
        """Try no more; a call that is under way has a few seconds to end."""
        self._given_up.set()
        self.join(3.0)


class Reasons:
    """Why a device is not there, each told once; numbers aside, which change from try to try.

    Parameters
    ----------
    first
        Told already.
    """

    def __init__(self, first: str) -> None:
        self._told = {_gist(first)}

    def new(self, reason: str) -> str:
        """Return the reason where it is to be told, else nothing."""
        gist = _gist(reason)
        if not reason or gist in self._told or len(self._told) > _MOST_REASONS:
            return ""
        self._told.add(gist)
        return reason


def _gist(reason: str) -> str:
    return re.sub(r"[\d.]+", "", reason)
