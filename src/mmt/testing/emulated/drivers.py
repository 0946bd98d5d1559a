"""Drivers of the virtual lab: the real ones, at the addresses of emulated devices."""

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Any, ClassVar, Final, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from mmt.core.errors import DeviceLost, naming
from mmt.core.frames import AccelerationRateHz
from mmt.devices.drivers import Role, load_device, read_options
from mmt.devices.leader_reports import ActuatorStatistics
from mmt.devices.protocols import (
    USUAL_RATE_HZ,
    RespondingActuator,
    SampledSensor,
    SetupRemarks,
    VoltageActuator,
)
from mmt.testing.emulated.lab_process import LabProcess
from mmt.testing.emulated.robot import DatagramRobot


class HandleLabOptions(BaseModel):
    """Options of the emulated handle, taken from the first of its devices that connects."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int = Field(1, ge=0, lt=2**63)
    """Seed of the noise, and of the texture if there is one."""

    @property
    def arguments(self) -> tuple[str, ...]:
        """Arguments of the lab's process."""
        return (str(self.seed),)


class LabOptions(HandleLabOptions):
    """Options of the lab, taken from the first of its devices that connects."""

    surface: str = "plastic"
    """Name of a simulated surface."""
    acceleration_rate_hz: AccelerationRateHz = 1000
    """Rate of the world's vibration, as in ``[session]``; the ADXL335 measures at twice it."""

    @property
    def arguments(self) -> tuple[str, ...]:
        """Arguments of the lab's process."""
        return (self.surface, str(self.acceleration_rate_hz // 1000), *super().arguments)


Method = TypeVar("Method", bound=Callable[..., Any])


LAB: Final = LabProcess("mmt.testing.emulated.lab")
"""Process of the world and its devices; the handle's lab is another one."""
_HANDLE_LAB: Final = LabProcess("mmt.testing.emulated.handle_lab")


def forwarded(method: Method) -> Method:
    """Return a method of a `VirtualDevice` that calls this one of its real driver."""

    @wraps(method)
    def call(device: "VirtualDevice", *arguments: Any) -> Any:
        return getattr(device._connected(), method.__name__)(*arguments)

    return call  # type: ignore[return-value]


class VirtualDevice:
    """A real driver at the address of a lab's emulated device.

    Parameters
    ----------
    **options
        Options of the driver, and those of the lab.

    Raises
    ------
    InputError
        An option is not allowed.
    """

    NAME: ClassVar[str]
    """Name of the device in a scene."""
    DRIVER: ClassVar[str]
    """Name of the real driver."""
    ROLE: ClassVar[Role | None] = None
    """Role of the driver, if it has several."""
    ADDRESS: ClassVar[str]
    """Name of its device in the lab."""
    NEEDED: ClassVar[Mapping[str, Any]] = {}
    """Options that the driver requires, with any values: the lab gives the true ones."""
    PROCESS: ClassVar = LAB
    LAB_OPTIONS: ClassVar[type[HandleLabOptions]] = LabOptions

    def __init__(self, **options: Any) -> None:
        own = {key: options.pop(key) for key in self.LAB_OPTIONS.model_fields if key in options}
        self._lab_arguments = read_options(self.LAB_OPTIONS, self.NAME, own).arguments
        self._options = options
        with naming(self.NAME):  # at any address: a wrong option is told before the lab starts
            load_device(self.DRIVER, {**self.NEEDED, **options}, role=self.ROLE)
        self._device: Any = None
        self._connected_to: dict[str, Any] = {}

    @property
    def faults(self) -> Mapping[str, int]:
        """Faults of the real driver."""
        faults: Mapping[str, int] = getattr(self._device, "faults", {})
        return faults

    def remarks(self) -> Sequence[str]:
        """Remarks of the real driver."""
        return self._device.remarks() if isinstance(self._device, SetupRemarks) else []

    def connect(self) -> None:
        """Start the lab, and connect the real driver to it."""
        address = self._enter()
        if self._device is not None and address != self._connected_to:
            self._device.close()  # its lab has ended
            self._device = None
        if self._device is None:
            self._device, self._connected_to = self._made(address), address
        self._connected().connect()

    def calibrate(self) -> None:
        """Calibrate the real driver."""
        self._connected().calibrate()

    def close(self) -> None:
        """Close the real driver and leave the lab; calling it twice is harmless."""
        if self._device is not None:
            self._device.close()
        self.PROCESS.release(self)

    def _made(self, address: dict[str, Any]) -> Any:
        """Return the real driver, with the options of the address and of the scene."""
        return load_device(self.DRIVER, {**address, **self._options}, role=self.ROLE)

    def _enter(self) -> dict[str, Any]:
        """Start the lab; return the options by which the driver finds its device."""
        return self.PROCESS.address(self, self.ADDRESS, *self._lab_arguments)

    def _connected(self) -> Any:
        if self._device is None:
            raise DeviceLost(f"{self.NAME} is not connected")
        return self._device


class VirtualRobot(VirtualDevice):
    """The simulated robot, by datagrams; see `LabOptions`."""

    NAME, ADDRESS = "virtual-robot", "robot"
    DRIVER = f"{DatagramRobot.__module__}:{DatagramRobot.__name__}"
    NEEDED: ClassVar = {"port": 0}

    def __init__(self, **options: Any) -> None:
        read_options(LabOptions, self.NAME, options)  # it has no others
        super().__init__(**options)

    read = forwarded(DatagramRobot.read)
    write = forwarded(DatagramRobot.write)


class VirtualSensor(VirtualDevice):
    """A `VirtualDevice` that is a sensor."""

    @property
    def latency_ns(self) -> int:
        """Latency of the real driver, once it is connected."""
        latency_ns: int = 0 if self._device is None else self._device.latency_ns
        return latency_ns

    read = forwarded(SampledSensor.read)


class VirtualNetFt(VirtualSensor):
    """The force sensor of the virtual lab; it takes the options of ``ati-net-ft`` too."""

    NAME, DRIVER, ADDRESS = "virtual-net-ft", "ati-net-ft", "net_ft"


class VirtualAdxl335(VirtualSensor):
    """The accelerometer of the virtual lab; it takes the options of ``adxl335-serial`` too."""

    NAME, DRIVER, ADDRESS = "virtual-adxl335", "adxl335-serial", "adxl335"
    NEEDED: ClassVar = {"port": "lab"}


class VirtualHandleAdxl335(VirtualAdxl335):
    """The accelerometer on the emulated handle that the `VirtualHaptuator` shakes."""

    NAME = "virtual-handle-adxl335"
    PROCESS, LAB_OPTIONS = _HANDLE_LAB, HandleLabOptions


class VirtualHaptuator(VirtualDevice):
    """The driver of a Haptuator's board, at an emulated board on an emulated handle.

    Parameters
    ----------
    **options
        Those of ``haptuator-serial`` except `port` and `full_scale_v`, and `HandleLabOptions`.
    """

    NAME, DRIVER, ADDRESS = "virtual-haptuator", "haptuator-serial", "haptuator"
    NEEDED: ClassVar = {"port": "lab", "full_scale_v": 1.0}
    PROCESS, LAB_OPTIONS = _HANDLE_LAB, HandleLabOptions
    _rate_hz = USUAL_RATE_HZ

    def set_rate(self, rate_hz: float) -> None:
        """Take the rate of the samples, for the real driver."""
        self._rate_hz = rate_hz

    write = forwarded(VoltageActuator.write)
    write_volts = forwarded(VoltageActuator.write_volts)
    response = forwarded(RespondingActuator.response)

    @property
    def largest_v(self) -> float:
        """Largest voltage of the real driver, 0 before it is connected."""
        largest_v: float = 0.0 if self._device is None else self._device.largest_v
        return largest_v

    @property
    def statistics(self) -> ActuatorStatistics:
        """Counts and levels of the real driver."""
        statistics: ActuatorStatistics = self._connected().statistics
        return statistics

    def _made(self, address: dict[str, Any]) -> Any:
        made = super()._made(address)
        made.set_rate(self._rate_hz)
        return made
