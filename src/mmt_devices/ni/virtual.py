"""``virtual-ni-daqmx``: NI board of the virtual lab, with gauges and an accelerometer."""

import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError

from mmt.core.arrays import FloatArray
from mmt.devices.adxl335.gravity import nominal
from mmt.devices.ati.gauges import load_calibration_file
from mmt.testing.emulated.drivers import LAB, LabOptions
from mmt_devices.ni.driver import NiOptions, NiVoltages
from mmt_devices.ni.emulated import INPUTS, EmulatedNi
from mmt_devices.ni.virtual_lab import ANSWER_S, LARGEST_BYTES

GAUGES: Final = slice(0, 6)
AXES: Final = [6, 7, 14]
"""Inputs of the accelerometer, against ground; `GAUGES` are differential inputs."""
_OFFSET_V: Final = 0.2
_VOLTS_PER_N: Final = 0.5 * np.eye(6, 3)
"""Without a calibration file: gauge k measures the force along axis k."""


class VirtualNiOptions(NiOptions, LabOptions):
    """Options of ``ni-daqmx``, of the lab, and the board's wiring."""

    calibration_file: Path | None = None
    """``.cal`` file of the force sensor whose gauges are wired; None for 2 N a volt."""


@dataclass
class _LabInputs:
    """Gets the voltages at the board's inputs from the lab, which is another process."""

    port: int = 0
    volts_per_n: FloatArray = field(default_factory=lambda: _VOLTS_PER_N)

    def __call__(self, times_ns: Sequence[int]) -> FloatArray:
        """Return the voltages at these times, as a `VoltsAt` of `EmulatedNi`."""
        felt = self._ask(times_ns)
        volts = np.zeros((len(times_ns), INPUTS))
        volts[:, GAUGES] = felt[:, :3] @ self.volts_per_n.T + _OFFSET_V
        sensor = nominal(3.3)
        volts[:, AXES] = np.array(sensor.zero_v) + sensor.gain_v_per_m_s2 * felt[:, 3:]
        return volts

    def _ask(self, times_ns: Sequence[int]) -> FloatArray:
        """Ask the lab for force (N) and acceleration (m/s2), shape (n, 6)."""
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
                link.settimeout(ANSWER_S)
                link.connect(("127.0.0.1", self.port))
                link.send(np.array(times_ns, dtype="<i8").tobytes())
                return np.frombuffer(link.recv(LARGEST_BYTES), dtype="<f8").reshape(-1, 6)
        except OSError as error:
            raise DaqError(
                "The virtual lab has ended.", DAQmxErrors.DEV_CANNOT_BE_ACCESSED
            ) from error


_INPUTS: Final = _LabInputs()
_BOARD: Final = EmulatedNi(_INPUTS, clock_ppm=50.0)
"""The one board that all drivers of this process share."""


class VirtualNi(NiVoltages):
    """NI board of the virtual lab."""

    OPTIONS = VirtualNiOptions

    def __init__(self, options: VirtualNiOptions) -> None:
        super().__init__(options, _BOARD)
        self._lab, file = options.arguments, options.calibration_file
        self._matrix = None if file is None else np.array(load_calibration_file(file).matrix)

    def connect(self) -> None:
        """Start the lab, and the board's task."""
        _INPUTS.port = LAB.address(self, "ni", *self._lab)["port"]
        if self._matrix is not None:
            _INPUTS.volts_per_n = np.linalg.inv(self._matrix).astype(np.float64)[:, :3]
        super().connect()

    def close(self) -> None:
        """Release the board and leave the lab; calling it twice is harmless."""
        super().close()
        if self._matrix is not None:
            _INPUTS.volts_per_n = _VOLTS_PER_N
        LAB.release(self)
