"""Drivers of the virtual lab: the real ones, at the addresses of emulated devices.

The lab runs in a process of its own that begins with the first of them that is connected and
ends with the last that is closed, or with this process.
"""

import json
import select
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import Any, Final

from pydantic import BaseModel, ConfigDict, Field

from mmt.devices.emulated.robot_link import NO_COMMAND, PACKET
from mmt.devices.loading import load_device, read_options
from mmt.devices.protocols import SampledSensor, SensorReading, Vector
from mmt.errors import DeviceLost, MmtError

_START_S: Final = 20.0
_ANSWER_S: Final = 2.0
_SILENT_READS: Final = 100


class LabOptions(BaseModel):
    """What the first device that is connected makes of the lab."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    surface: str = "plastic"
    """Of the simulated ones."""
    seed: int = Field(1, ge=0, lt=2**63)
    """Of texture and noise."""


class _Lab:
    """The lab's process, shared by the devices of this one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users: set[int] = set()
        self._process: subprocess.Popen[str] | None = None
        self._addresses: dict[str, dict[str, Any]] = {}

    def enter(self, user: object, options: LabOptions) -> dict[str, dict[str, Any]]:
        """Start it where it does not run; return the addresses."""
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                self._users.clear()
                self._start(options)
            self._users.add(id(user))
            return self._addresses

    def leave(self, user: object) -> None:
        """End it after its last user."""
        with self._lock:
            self._users.discard(id(user))
            if not self._users and self._process is not None:
                self._end(self._process)
                self._process = None

    def _start(self, options: LabOptions) -> None:
        words = [sys.executable, "-m", "mmt.devices.emulated.lab", options.surface]
        self._process = subprocess.Popen(  # noqa: S603 - our own module
            [*words, str(options.seed)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the service; schedulers share by session
        )
        said = self._process.stdout
        assert said is not None  # noqa: S101 - a pipe was asked for
        line = said.readline() if select.select([said], [], [], _START_S)[0] else ""
        if not line:
            reason = self._end(self._process)
            self._process = None
            raise MmtError(f"the virtual lab does not start: {reason or 'it says nothing'}")
        self._addresses = json.loads(line)

    def _end(self, process: "subprocess.Popen[str]") -> str:
        """End it and return the last line of what it said went wrong."""
        try:
            _, said = process.communicate(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            _, said = process.communicate()
        lines = said.strip().splitlines()
        return lines[-1] if lines else ""


_LAB: Final = _Lab()


class VirtualRobot:
    """The simulated robot, by datagrams; see `LabOptions`."""

    def __init__(self, **options: Any) -> None:
        self._options = read_options(LabOptions, "virtual-robot", options)
        self._socket: socket.socket | None = None
        self._position: Vector | None = None
        self._empty = 0

    def connect(self) -> None:
        """Start the lab, and wait for the first position."""
        self.close()
        port = _LAB.enter(self, self._options)["robot"]["port"]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.setblocking(False)
        self._socket.send(NO_COMMAND)
        select.select([self._socket], [], [], _ANSWER_S)
        self._drain(self._socket)
        if self._position is None:
            raise MmtError("the virtual robot does not answer: end what loads this machine")

    def calibrate(self) -> None:
        """Do nothing: it is calibrated."""

    def read(self) -> Vector:
        """Return the newest position (mm)."""
        if self._socket is None or self._position is None:
            raise DeviceLost("the virtual robot is not connected")
        self._drain(self._socket)
        if self._empty > _SILENT_READS:
            raise DeviceLost("the virtual robot says nothing: its lab has ended")
        return self._position

    def write(self, position_mm: Vector) -> None:
        """Command a position (mm)."""
        if self._socket is None:
            raise DeviceLost("the virtual robot is not connected")
        try:
            self._socket.send(PACKET.pack(*position_mm))
        except BlockingIOError:
            return  # the next one is newer anyhow
        except OSError as error:
            raise DeviceLost(f"the virtual robot is gone: {error}") from error

    def close(self) -> None:
        """Leave the lab; calling it twice is harmless."""
        if self._socket is not None:
            self._socket.close()
            self._socket = self._position = None
            self._empty = 0
            _LAB.leave(self)

    def _drain(self, link: socket.socket) -> None:
        self._empty += 1
        try:
            while len(packet := link.recv(64)) == PACKET.size:
                self._position = PACKET.unpack(packet)
                self._empty = 0
        except BlockingIOError:
            return
        except OSError as error:
            raise DeviceLost(f"the virtual robot is gone: {error}") from error


class VirtualSensor:
    """A real driver at the address of the lab's emulated device.

    Parameters
    ----------
    name
        What a scene calls it.
    driver
        The real one.
    address
        Its device in the lab.
    options
        Of the driver; `LabOptions` among them are the lab's.
    """

    def __init__(self, name: str, driver: str, address: str, options: Mapping[str, Any]) -> None:
        lab_keys = set(LabOptions.model_fields)
        own = {key: value for key, value in options.items() if key in lab_keys}
        self._lab_options = read_options(LabOptions, name, own)
        self._options = {key: value for key, value in options.items() if key not in lab_keys}
        self._driver, self._address = driver, address
        self._device: SampledSensor | None = None
        self._connected_to: dict[str, Any] = {}

    @property
    def latency_ns(self) -> int:
        """Of the real driver, once it is connected."""
        return 0 if self._device is None else self._device.latency_ns

    @property
    def faults(self) -> Mapping[str, int]:
        """Of the real driver."""
        return {} if self._device is None else self._device.faults

    def connect(self) -> None:
        """Start the lab, and connect the real driver to it."""
        address = _LAB.enter(self, self._lab_options)[self._address]
        if self._device is None or address != self._connected_to:
            self._device = load_device(self._driver, {**address, **self._options})
            self._connected_to = address
        self._connected().connect()

    def calibrate(self) -> None:
        """Calibrate the real driver."""
        self._connected().calibrate()

    def read(self) -> Sequence[SensorReading]:
        """Read the real driver."""
        return self._connected().read()

    def close(self) -> None:
        """Close the real driver and leave the lab; calling it twice is harmless."""
        if self._device is not None:
            self._device.close()
        _LAB.leave(self)

    def _connected(self) -> SampledSensor:
        if self._device is None:
            raise DeviceLost(f"the virtual {self._driver} is not connected")
        return self._device


def virtual_net_ft(**options: Any) -> VirtualSensor:
    """Make the force sensor of the virtual lab; it takes the options of ``ati-net-ft`` too."""
    return VirtualSensor("virtual-net-ft", "ati-net-ft", "net_ft", options)


def virtual_adxl335(**options: Any) -> VirtualSensor:
    """Make the accelerometer of the virtual lab; it takes those of ``adxl335-serial`` too."""
    return VirtualSensor("virtual-adxl335", "adxl335-serial", "adxl335", options)
