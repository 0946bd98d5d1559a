"""An actuator that may be lost: the session goes on without it until it is there again."""

from collections.abc import Sequence

from mmt.arrays import FloatArray
from mmt.devices.ports import Reconnection
from mmt.devices.protocols import ActuatorStatistics, VibrationActuator
from mmt.errors import DeviceLost


class MendedActuator:
    """A `VibrationActuator` that connects its device again when that is lost.

    Meanwhile nothing is played, and what would have been is counted.

    Parameters
    ----------
    device
        The driver's; it raises `DeviceLost` where it may come back.
    """

    def __init__(self, device: VibrationActuator) -> None:
        self.device = device
        self.losses = 0
        """How often it was lost."""
        self.lost_samples = 0
        """Samples that were not played, since it was not there."""
        self._reconnection: Reconnection | None = None
        self._news: list[str] = []

    def connect(self) -> None:
        """Open the device."""
        self.device.connect()

    def calibrate(self) -> None:
        """Calibrate the device."""
        self.device.calibrate()

    def close(self) -> None:
        """Release the device; calling it twice is harmless."""
        if self._reconnection is not None:
            self._reconnection.give_up()
            self._reconnection = None
        self.device.close()

    def write(self, samples_m_s2: Sequence[float] | FloatArray) -> None:
        """Play samples (n,), m/s2, or count them where the device is not there."""
        if self._reconnection is not None:
            if not self._reconnection.done.is_set():
                self.lost_samples += len(samples_m_s2)
                return
            self._reconnection = None
            self._news.append("the actuator is back")
        try:
            self.device.write(samples_m_s2)
        except DeviceLost as error:
            self.losses += 1
            self.lost_samples += len(samples_m_s2)
            self._news.append(f"actuator lost: {error}; it is silent until it is back")
            self._reconnection = Reconnection(self.device)

    @property
    def statistics(self) -> ActuatorStatistics:
        """Counts and levels of the device."""
        return self.device.statistics

    @property
    def losses_summary(self) -> dict[str, int]:
        """How often it was lost and what was not played, for a program."""
        return {"losses": self.losses, "lost_samples": self.lost_samples}

    def take_news(self) -> list[str]:
        """Return what has happened since the last call, a sentence each."""
        news, self._news = self._news, []
        return news
