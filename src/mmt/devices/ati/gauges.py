"""Force from bare gauge voltages on an acquisition board, by the sensor's ``.cal`` file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from mmt.core.errors import DeviceLost, InputError
from mmt.devices.ati.calibration import AtiOptions, check_calibration
from mmt.devices.ati.calibration_file import FileCalibration, load_calibration_file
from mmt.devices.drivers import load_device, read_options
from mmt.devices.protocols import VoltageBoard, arrival_of
from mmt.devices.wrench_sensor import Stamped, WrenchSensor
from mmt.scene import Driver

DRIVER: Final = "ati-gauges"

_SATURATED: Final = 0.99
"""Share of the largest voltage at which a gauge counts as saturated."""


class GaugesOptions(AtiOptions):
    """Options of ``ati-gauges``."""

    calibration_file: Path
    """The sensor's ``.cal`` file."""
    board: Driver
    """Driver and options of the board; its first six inputs are the gauges G0 to G5."""


def gauges(**options: Any) -> "Gauges":
    """Make the driver and that of its board; see `GaugesOptions`.

    Raises
    ------
    InputError
        An option is not allowed.
    """
    checked = read_options(GaugesOptions, DRIVER, options)
    return Gauges(checked, load_device(checked.board.driver, checked.board.options, role="board"))


class Gauges(WrenchSensor):
    """A `SampledSensor` of forces behind an acquisition board.

    Parameters
    ----------
    options
        See `GaugesOptions`.
    board
        Board that samples the voltages.

    Raises
    ------
    InputError
        The calibration cannot be used, is not the expected one, or the board has too few inputs.
    """

    def __init__(self, options: GaugesOptions, board: VoltageBoard) -> None:
        super().__init__(f"gauges by {options.calibration_file.name}", options)
        self._board = board
        self._open = False
        self.loaded: FileCalibration = load_calibration_file(options.calibration_file)
        """Contents of the calibration file."""
        check_calibration(self.name, self.loaded.calibration, options)
        if board.inputs < 6:
            raise InputError(
                f"{self.name}: the board is set to {board.inputs} inputs, the gauges need six"
            )
        self._limit_v = _SATURATED * min(self.loaded.output_v, board.limit_v)

    def connect(self) -> None:
        """Open the board and wait for its first voltages.

        Raises
        ------
        MmtError
            The board does not answer, or gives no voltages.
        """
        self.close()
        self._board.connect()
        self._open = True
        calibration = self.loaded.calibration
        self._set_matrix(self.loaded.matrix, calibration.range_n, calibration.range_n_mm)
        self._set_latency(self._board.latency_ns)
        self._await_record()

    def close(self) -> None:
        """Close the board; calling it twice is harmless."""
        if self._open:
            self._open = False
            self._board.close()

    @property
    def arrival_ns(self) -> int:
        """Arrival time of the newest reading (ns, host's clock), or now if the board has none."""
        return arrival_of(self._board)

    def _explain_absence(self) -> str:
        return f"{self.name}: the board gives no voltages; {self._where()}"

    def _where(self) -> str:
        return "check the board's cable and its driver's options"

    def _receive(self, now_ns: int) -> list[Stamped]:  # noqa: ARG002 - the board has a clock
        if not self._open:
            raise DeviceLost(f"{self.name} is closed: connect it again")
        limit_v = self._limit_v
        records: list[Stamped] = []
        for time_ns, volts in self._board.read():
            a, b, c, d, e, f = raw = volts[0], volts[1], volts[2], volts[3], volts[4], volts[5]
            if max(a, b, c, d, e, f) >= limit_v or min(raw) <= -limit_v:
                self._saturate()
            records.append((time_ns, raw))
        return records

    def _further_faults(self) -> Mapping[str, int]:
        return {f"board: {reason}": count for reason, count in self._board.faults.items()}
