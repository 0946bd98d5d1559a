"""A continuous, hardware-timed task of an NI board, read by a thread."""

import contextlib
import threading
import time
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from nidaqmx.constants import AcquisitionType, TerminalConfiguration, WaitMode
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError, Error
from nidaqmx.stream_readers import AnalogMultiChannelReader

from mmt.core.arrays import FloatArray
from mmt.core.errors import DeviceLost
from mmt.core.output.logs import RepeatLimit
from mmt.core.running.process import follow_real_time
from mmt.devices.board_sharing import StreamData
from mmt.devices.protocols import VoltageReading
from mmt.devices.reading_checks import LOG, QUIET_S
from mmt_devices.ni.daqmx import Daqmx, explain, explained

_TERMINALS: Final = {
    "differential": TerminalConfiguration.DIFF,
    "rse": TerminalConfiguration.RSE,
    "nrse": TerminalConfiguration.NRSE,
}
_OVERRUNS: Final = {
    DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE,
    DAQmxErrors.INPUT_FIFO_OVERFLOW,
    DAQmxErrors.INPUT_FIFO_OVERFLOW_2,
}
_BUFFER_S: Final = 2.0
_BLOCKS_HZ: Final = 1000.0
_SLEEP_S: Final = 0.0002
"""Pause between NI-DAQmx's checks for samples; without a pause it keeps a core busy."""
_SILENT_S: Final = 0.2
_MOST_DRIFT: Final = 2e-4
"""Largest relative drift of the board's clock against the host's."""
_MOST_WAITING: Final = 8192
"""Most blocks that wait to be taken; beyond, the oldest are dropped and counted."""


class NiInput(NamedTuple):
    """One analogue input and its settings."""

    number: int
    terminals: str
    range_v: float


class NiStream:
    """`BoardStream` of an NI board.

    Parameters
    ----------
    daqmx
        Access to NI-DAQmx, which makes the tasks.
    device
        The board.
    rate_hz
        Scans a second.
    inputs
        Inputs, in the order of the voltages in a scan.

    Raises
    ------
    MmtError
        NI-DAQmx reports an error, which the message states.
    """

    def __init__(
        self, daqmx: Daqmx, device: Any, rate_hz: float, inputs: Sequence[NiInput]
    ) -> None:
        self.board: str = device.name
        self.serial = f"ni-{device.serial_num:X}"
        self._daqmx, self._wanted_hz, self._inputs = daqmx, rate_hz, tuple(inputs)
        self._arrived: deque[StreamData] = deque(maxlen=_MOST_WAITING)
        self._ending = threading.Event()
        self._lost = ""
        self._scan = 0
        self._faults: Counter[str] = Counter()
        self._notice = RepeatLimit(QUIET_S)
        with explained():
            self._task, self._rate_hz = self._start()
        self._heard_ns = time.monotonic_ns()
        self._zero_ns = float(self._heard_ns)
        """Host time of the first scan, estimated from the blocks that arrived soonest."""
        self._thread = threading.Thread(target=self._run, name=f"NI {self.board}", daemon=True)
        self._thread.start()

    @property
    def is_streaming(self) -> bool:
        """Whether the board is there and scans have arrived within the last 0.2 s."""
        return not self._lost and time.monotonic_ns() - self._heard_ns < 1e9 * _SILENT_S

    def read_scans(self) -> StreamData:
        """Return the scans that have arrived; see `BoardStream`."""
        waiting = self._arrived
        taken = [waiting.popleft() for _ in range(len(waiting))]
        if not taken:
            if self._lost:
                raise DeviceLost(f"the board by NI {self.board} is gone: {self._lost}")
            return StreamData([], 0, Counter())
        faults: Counter[str] = Counter()
        for block in taken:
            faults.update(block.faults)
        scans = [scan for block in taken for scan in block.scans]
        return StreamData(scans, taken[-1].arrival_ns, faults)

    def close(self) -> None:
        """End the task; calling it twice is harmless."""
        self._ending.set()
        self._thread.join(timeout=5.0)
        self._clear()

    def _start(self) -> tuple[Any, float]:
        """Start a task; return it and its actual rate."""
        task = self._daqmx.task()
        try:
            for number, terminals, range_v in self._inputs:
                task.ai_channels.add_ai_voltage_chan(
                    f"{self.board}/ai{number}",
                    terminal_config=_TERMINALS[terminals],
                    min_val=-range_v,
                    max_val=range_v,
                )
            task.timing.cfg_samp_clk_timing(
                self._wanted_hz,
                sample_mode=AcquisitionType.CONTINUOUS,
                samps_per_chan=round(_BUFFER_S * self._wanted_hz),
            )
            task.in_stream.wait_mode = WaitMode.SLEEP
            task.in_stream.sleep_time = _SLEEP_S
            task.start()
            return task, float(task.timing.samp_clk_rate)
        except BaseException:
            task.close()
            raise

    def _clear(self) -> None:
        task, self._task = self._task, None
        if task is not None:
            with contextlib.suppress(Error):  # the board may be gone
                task.close()

    def _run(self) -> None:
        follow_real_time()
        try:
            while not self._ending.is_set():
                try:
                    self._read()
                except DaqError as error:
                    if error.error_type not in _OVERRUNS:
                        raise
                    self._begin_anew()
        except Error as error:
            self._lost = explain(error)

    def _read(self) -> None:
        """Read blocks of about 1 ms until the stream is closed."""
        volts = np.empty((len(self._inputs), max(1, round(self._rate_hz / _BLOCKS_HZ))))
        reader = AnalogMultiChannelReader(self._task.in_stream)
        reader.verify_array_shape = False  # the check would ask the board each time
        while not self._ending.is_set():
            reader.read_many_sample(volts, volts.shape[1], timeout=_SILENT_S)
            self._heard_ns = arrival_ns = time.monotonic_ns()
            self._put(volts, arrival_ns)

    def _put(self, volts: FloatArray, arrival_ns: int) -> None:
        period_ns = 1e9 / self._rate_hz
        scans = [
            VoltageReading(round(number * period_ns), tuple(row))
            for number, row in enumerate(volts.T.tolist(), self._scan)
        ]
        self._scan += len(scans)
        self._zero_ns = min(
            self._zero_ns + _MOST_DRIFT * len(scans) * period_ns,
            arrival_ns - self._scan * period_ns,
        )
        if len(self._arrived) == _MOST_WAITING:
            self._faults["lost scans"] += len(scans)
        faults, self._faults = self._faults, Counter()
        self._arrived.append(StreamData(scans, arrival_ns, faults))

    def _begin_anew(self) -> None:
        """Start another task after an overrun; count the lost scans by the host's clock."""
        self._clear()
        self._task, self._rate_hz = self._start()
        passed_s = 1e-9 * (time.monotonic_ns() - self._zero_ns)
        missed = max(0, round(passed_s * self._rate_hz) - self._scan)
        self._scan += missed
        self._faults.update({"overruns": 1, "lost scans": missed})
        self._notice.warn(
            LOG,
            f"the board by NI {self.board} was read too late, and {missed} scans are lost: lower "
            "rate_hz, or take load off this machine",
        )
