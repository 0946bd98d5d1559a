# ruff: noqa: ARG002, D102 - the overridden methods are NI's
"""Emulated NI board: replaces the NI-DAQmx library below NI's package ``nidaqmx``."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from nidaqmx._library_interpreter import LibraryInterpreter
from nidaqmx.constants import TerminalConfiguration
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError, DaqReadError
from nidaqmx.system._collections.device_collection import DeviceCollection
from nidaqmx.task._task import _TaskAlternateConstructor

from mmt.core.arrays import FloatArray
from mmt_devices.ni.daqmx import Daqmx

INPUTS: Final = 16
_PARTNER: Final = 8
"""Input n is measured differentially against input n + 8."""
_PRODUCT: Final = 0x0631
_CLOCK_HZ: Final = 20e6
_BITS: Final = 16
_NOISE_V: Final = 2e-4
"""Standard deviation of the noise on each input."""
_WAIT_S: Final = 0.0002
_MOST_AT_ONCE: Final = 1000

VoltsAt = Callable[[Sequence[int]], FloatArray]
"""Returns the inputs' voltages to ground (V) at n monotonic times (ns), shape (n, `INPUTS`)."""


@dataclass
class _Acquisition:
    """State of one NI-DAQmx task."""

    channels: list[tuple[int, bool, float]] = field(default_factory=list)
    """Of each channel: input number, whether it is differential, and range (V)."""
    rate_hz: float = 0.0
    buffer: int = 0
    begun_ns: int = 0
    """Monotonic time of the start, 0 before it."""
    taken: int = 0
    ready: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    """Voltages of scans that are measured but not yet read, shape (channels, n)."""


class EmulatedNi(LibraryInterpreter, Daqmx):
    """Emulated USB-6251 ``Dev1``, with faults on demand; pass it to the driver as `backend`.

    Parameters
    ----------
    volts_at
        Gives the voltages at the inputs.
    clock_ppm
        By how much the board samples too fast, in ppm.
    """

    name = "Dev1"

    def __init__(self, volts_at: VoltsAt, *, clock_ppm: float = 0.0) -> None:
        self.plugged = True
        self.stalled = False
        """Whether reads get no samples."""
        self._volts_at = volts_at
        self._speed = 1.0 + 1e-6 * clock_ppm
        self._random = np.random.default_rng(1)
        self._running: _Acquisition | None = None

    def devices(self) -> Any:
        """Return NI's collection of devices, with this board only."""
        return DeviceCollection(self)

    def task(self) -> Any:
        """Return a new task of NI's package."""
        return _TaskAlternateConstructor(_Acquisition(), self, close_on_exit=True)

    @property
    def channels(self) -> int:
        """Number of inputs of the running task, 0 if none runs."""
        return 0 if self._running is None else len(self._running.channels)

    def lag(self, scans: int) -> None:
        """Add this many scans to those that wait to be read."""
        if self._running is not None:
            self._running.begun_ns -= round(scans * 1e9 / self._running.rate_hz)

    # Calls by NI's package; an `attribute` is a code of NI-DAQmx

    def get_system_info_attribute_string(self, attribute: int) -> str:
        return self.name if self.plugged else ""

    def get_device_attribute_string(self, device_name: str, attribute: int) -> str:
        if attribute == _PRODUCT:
            return "USB-6251"
        return ", ".join(f"{device_name}/ai{number}" for number in range(INPUTS))

    def get_device_attribute_uint32(self, device_name: str, attribute: int) -> int:
        return 0x1A2B3C  # its serial number

    def get_device_attribute_double(self, device_name: str, attribute: int) -> float:
        return 1e6  # samples a second, all inputs together

    def get_task_attribute_string(self, task: _Acquisition, attribute: int) -> str:
        return f"_unnamedTask<{id(task):x}>"

    def create_ai_voltage_chan(
        self, task: _Acquisition, channel: str, name: str, terminals: int, low_v: float,
        high_v: float, units: int, scale: str,
    ) -> None:  # fmt: skip
        number = int(channel.rpartition("/ai")[2])
        differential = terminals == TerminalConfiguration.DIFF.value
        if differential and number >= _PARTNER:
            raise DaqError(
                "Requested value is not a supported value for this property.\n\nProperty: "
                "DAQmx_AI_TermCfg\nPossible Values: DAQmx_Val_RSE, DAQmx_Val_NRSE",
                DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            )
        task.channels.append((number, differential, high_v))

    def internal_get_last_created_chan(self) -> None:
        return None

    def cfg_samp_clk_timing(
        self, task: _Acquisition, rate_hz: float, source: str, edge: int, mode: int, buffer: int
    ) -> None:
        task.rate_hz = _CLOCK_HZ / int(_CLOCK_HZ / rate_hz)
        task.buffer = buffer

    def get_timing_attribute_double(self, task: _Acquisition, attribute: int) -> float:
        return task.rate_hz

    def set_read_attribute_int32(self, task: _Acquisition, attribute: int, value: int) -> None:
        return  # the wait mode

    def set_read_attribute_double(self, task: _Acquisition, attribute: int, value: float) -> None:
        return  # the sleep time

    def start_task(self, task: _Acquisition) -> None:
        self._check()
        if self._running is not None:
            raise DaqError("The specified resource is reserved.", DAQmxErrors.PAL_RESOURCE_RESERVED)
        self._running = task
        task.begun_ns, task.taken = time.monotonic_ns(), 0
        task.ready = np.empty((len(task.channels), 0))

    def clear_task(self, task: _Acquisition) -> None:
        if self._running is task:
            self._running = None

    def read_analog_f64(
        self, task: _Acquisition, count: int, timeout_s: float, fill: int, into: FloatArray
    ) -> tuple[FloatArray, int]:
        end_s = time.monotonic() + timeout_s
        while True:
            self._check()
            due = self._due(task)
            if due - task.taken > task.buffer:
                raise DaqReadError(
                    "The application is not able to keep up with the hardware acquisition.",
                    DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE,
                    0,
                )
            if due - task.taken >= count and not self.stalled:
                break
            if time.monotonic() >= end_s:
                raise DaqReadError(
                    "Some or all of the samples requested have not yet been acquired.",
                    DAQmxErrors.SAMPLES_NOT_YET_AVAILABLE,
                    0,
                )
            time.sleep(_WAIT_S)
        if task.ready.shape[1] < count:
            first = task.taken + task.ready.shape[1]
            more = self._measure(task, range(first, min(due, first + _MOST_AT_ONCE)))
            task.ready = np.concatenate([task.ready, more], axis=1)
        into[:] = task.ready[:, :count]
        task.ready = task.ready[:, count:]
        task.taken += count
        return into, count

    def _due(self, task: _Acquisition) -> int:
        """Return the number of scans acquired since the start."""
        return int((time.monotonic_ns() - task.begun_ns) / self._period_ns(task))

    def _period_ns(self, task: _Acquisition) -> float:
        return 1e9 / (task.rate_hz * self._speed)

    def _measure(self, task: _Acquisition, scans: range) -> FloatArray:
        """Return the voltages of scans, shape (channels, n), rounded to the converter's counts."""
        period_ns = self._period_ns(task)
        volts = self._volts_at([task.begun_ns + round(k * period_ns) for k in scans])
        numbers, differential, ranges_v = map(np.array, zip(*task.channels, strict=True))
        partners = np.where(differential, numbers + _PARTNER, INPUTS)
        grounded = np.concatenate([volts, np.zeros((len(volts), 1))], axis=1)
        there = self._random.normal(volts[:, numbers] - grounded[:, partners], _NOISE_V)
        count_v = 2.0 * ranges_v / 2**_BITS
        measured: FloatArray = np.clip(np.rint(there / count_v) * count_v, -ranges_v, ranges_v).T
        return measured

    def _check(self) -> None:
        if not self.plugged:
            raise DaqError(
                "Device cannot be accessed.  Possible causes:\nDevice is no longer present in the "
                "system.\nDevice is not powered.",
                DAQmxErrors.DEV_CANNOT_BE_ACCESSED,
            )
