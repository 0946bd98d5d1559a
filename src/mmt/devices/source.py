"""Stream what real devices measure: a robot, a force sensor, an accelerometer."""

from collections.abc import Iterable

import numpy as np

from mmt.arrays import RecordArray
from mmt.devices.protocols import Accelerometer, Device, ForceSensor, Robot, Vector
from mmt.errors import InputError
from mmt.frames import Channel, frame_dtype, ordered_channels


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
    def _devices(self) -> list[Device]:
        devices = (self._robot, self._force_sensor, self._accelerometer)
        return [device for device in devices if device is not None]

    def start(self, start_time_ns: int) -> None:  # noqa: ARG002 - devices keep their own time
        """Connect and calibrate the devices."""
        for device in self._devices:
            device.connect()
            device.calibrate()

    def step(self, elapsed: int, now_ns: int, command_position_mm: Vector | None) -> RecordArray:
        """Command the robot and read every device once; one frame, see `FollowerSource`."""
        if command_position_mm is not None:
            self._robot.write(command_position_mm)
        self._sequence += elapsed
        frames = np.zeros(1, dtype=self._dtype)
        frames["sequence"] = self._sequence - 1
        frames["time_ns"] = now_ns
        if "position" in self._channels:
            frames["position_mm"][0] = self._robot.read()
        if self._force_sensor is not None and "force" in self._channels:
            frames["force_n"][0] = self._force_sensor.read()
        if self._accelerometer is not None and "acceleration" in self._channels:
            frames["acceleration_m_s2"][0] = self._accelerometer.read()
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
        return "devices: " + ", ".join(type(device).__name__ for device in self._devices)

    def close(self) -> None:
        """Close every device, also when closing one of them fails."""
        problems: list[Exception] = []
        for device in self._devices:
            try:
                device.close()
            except Exception as error:  # noqa: BLE001 - the others must still be closed
                problems.append(error)
        if problems:
            raise problems[0]
