"""Stream what real devices measure: a robot, a force sensor, an accelerometer."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from mmt.arrays import RecordArray
from mmt.devices.protocols import Accelerometer, Device, ForceSensor, Robot, Vector
from mmt.errors import InputError, MmtError
from mmt.frames import Channel, frame_dtype, ordered_channels

_ROBOT: Final = "robot"
_FORCE_SENSOR: Final = "force sensor"
_ACCELEROMETER: Final = "accelerometer"


class DeviceSource:
    """A `FollowerSource` that reads devices at each tick.

    A tick that was missed has no measurement: its sequence number is skipped, so that the
    leader sees a gap and nothing is invented.

    Parameters
    ----------
    robot
        Gives the position and takes the motion commands.
    force_sensor, accelerometer
        None where the scene's channels need none.
    channels
        What to put into the frames.

    Raises
    ------
    InputError
        A channel has no device.
    """

    def __init__(
        self,
        robot: Robot,
        force_sensor: ForceSensor | None,
        accelerometer: Accelerometer | None,
        channels: Iterable[Channel],
    ) -> None:
        self._robot = robot
        self._force_sensor = force_sensor
        self._accelerometer = accelerometer
        self._channels = ordered_channels(channels)
        for channel, device in (("force", force_sensor), ("acceleration", accelerometer)):
            if channel in self._channels and device is None:
                key = "force_sensor" if channel == "force" else "accelerometer"
                raise InputError(f"[devices] has no {key}, but the scene needs {channel}")
        self._dtype = frame_dtype(self._channels)
        self._sequence = 0

    @property
    def _devices(self) -> dict[str, Device]:
        devices: dict[str, Device | None] = {
            _ROBOT: self._robot,
            _FORCE_SENSOR: self._force_sensor,
            _ACCELEROMETER: self._accelerometer,
        }
        return {role: device for role, device in devices.items() if device is not None}

    def start(self, start_time_ns: int) -> None:  # noqa: ARG002 - devices keep their own time
        """Connect and calibrate the devices.

        Raises
        ------
        MmtError
            One of them does not answer.
        """
        for role, device in self._devices.items():
            try:
                device.connect()
                device.calibrate()
            except Exception as error:
                raise _failure(role, device, error) from error

    def step(self, elapsed: int, now_ns: int, command_position_mm: Vector | None) -> RecordArray:
        """Command the robot and read every device once; one frame, see `FollowerSource`.

        Raises
        ------
        MmtError
            A device fails; the message says which.
        """
        self._sequence += elapsed
        frames = np.zeros(1, dtype=self._dtype)
        frames["sequence"] = self._sequence - 1
        frames["time_ns"] = now_ns
        role = _ROBOT
        try:
            if command_position_mm is not None:
                self._robot.write(command_position_mm)
            if "position" in self._channels:
                frames["position_mm"][0] = self._robot.read()
            if self._force_sensor is not None and "force" in self._channels:
                role = _FORCE_SENSOR
                frames["force_n"][0] = self._force_sensor.read()
            if self._accelerometer is not None and "acceleration" in self._channels:
                role = _ACCELEROMETER
                frames["acceleration_m_s2"][0] = self._accelerometer.read()
        except Exception as error:
            raise _failure(role, self._devices[role], error) from error
        return frames

    @property
    def finished(self) -> bool:
        """Devices go on until they are closed."""
        return False

    @property
    def annotations(self) -> bytes:
        """Nothing is known beside what is measured."""
        return b""

    def describe(self) -> str:
        """Name the devices."""
        return "devices: " + ", ".join(
            f"{role} {type(device).__name__}" for role, device in self._devices.items()
        )

    def close(self) -> None:
        """Close every device, also when closing one of them fails.

        Raises
        ------
        MmtError
            One or more could not be closed.
        """
        problems = []
        for role, device in self._devices.items():
            try:
                device.close()
            except Exception as error:  # noqa: BLE001 - the others must still be closed
                problems.append(str(_failure(role, device, error)))
        if problems:
            raise MmtError("; ".join(problems))


def _failure(role: str, device: Device, error: Exception) -> MmtError:
    """Return what a person is told when a device's driver raises, whatever it raises."""
    reason = str(error) or type(error).__name__
    return MmtError(f"the {role} ({type(device).__name__}) failed: {reason}")
