"""Force from bare gauge voltages on an acquisition board, by the matrix of ATI's ``.cal`` file."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mmt.core.bounds import finite_number
from mmt.core.errors import DeviceLost, InputError, naming, short_message
from mmt.core.files.untrusted import parse_xml
from mmt.devices.ati.calibration import (
    AtiOptions,
    Calibration,
    check_calibration,
    unit_size,
    wrench_units,
)
from mmt.devices.drivers import load_device
from mmt.devices.protocols import VoltageBoard, arrival_of
from mmt.devices.sensor_drivers import Stamped, WrenchSensor
from mmt.devices.wrench import matrix_of, six_of
from mmt.scene import Driver

_AXES: Final = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
_LARGEST: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class FileCalibration(Calibration):
    """Contents of a ``.cal`` file; its matrix is for volts."""

    output_v: float
    """Largest magnitude of the amplifier's output voltage."""


def load_calibration_file(path: Path) -> FileCalibration:
    """Read a ``.cal`` file.

    Raises
    ------
    InputError
        The file cannot be read or used; the message says why.
    """
    with naming(f"calibration {path}"):
        try:
            with path.open("rb") as file:
                content = file.read(_LARGEST + 1)
        except OSError as error:
            raise InputError(
                f"{error.strerror or error}; it came with the sensor, under the name of its serial "
                "number"
            ) from error
        if len(content) > _LARGEST:
            raise InputError("over 1 MiB, so it is no .cal file")
        return parse_calibration_file(content)


def parse_calibration_file(content: bytes) -> FileCalibration:
    """Read a ``.cal`` file's content.

    The ``UserAxis`` rows are the matrix. Files of version 1.0 have no ``UserAxis``: their ``Axis``
    rows are divided by the scales, and torques are moved to the displaced origin, T - D x F.

    Raises
    ------
    InputError
        The content cannot be used; the message says why.
    """
    root = parse_xml(content)
    calibration = root.find("Calibration")
    if root.tag != "FTSensor" or calibration is None:
        raise InputError("it has no FTSensor with a Calibration: it is no .cal file by ATI")
    if _number(calibration, "GainMultiplier", "1") != 1.0:
        raise InputError("its GainMultiplier is not 1, which is not supported")
    force_unit = _text(calibration, "ForceUnits")
    units = wrench_units(force_unit, _text(calibration, "TorqueUnits"), "the file")
    axes = _rows(calibration, "UserAxis")
    rows = [_values(axes[name]) for name in _AXES] if axes else _from_axes(calibration, units)
    ranges = axes or _rows(calibration, "Axis")
    limits = [unit * _number(ranges[name], "max") for name, unit in zip(_AXES, units, strict=True)]
    if min(limits) <= 0:
        raise InputError("its ranges 'max' are not above zero")
    try:
        matrix = matrix_of(
            [[unit * value for value in row] for row, unit in zip(rows, units, strict=True)]
        )
    except ValueError as error:
        raise InputError(f"its matrix cannot be used: {error}") from None
    output = _number(calibration, "OutputRange", "20")
    bipolar = calibration.get("OutputBipolar", "True").lower() == "true"
    return FileCalibration(
        serial=root.get("Serial", ""),
        part=calibration.get("PartNumber", ""),
        force_unit=force_unit,
        matrix=matrix,
        limits=six_of(limits),
        output_v=output / 2 if bipolar else output,
    )


def _from_axes(calibration: ET.Element, units: list[float]) -> list[list[float]]:
    """Return the rows of a file without ``UserAxis``, in the file's own units."""
    axes = _rows(calibration, "Axis")
    if not axes:
        raise InputError("it has neither UserAxis nor Axis rows")
    rows = []
    for name in _AXES:
        scale = _number(axes[name], "scale")
        if scale == 0:
            raise InputError(f"its scale of {name} is zero")
        rows.append([value / scale for value in _values(axes[name])])
    transform = calibration.find("BasicTransform")
    if transform is None:
        return rows
    if any(_number(transform, angle, "0") != 0 for angle in ("Rx", "Ry", "Rz")):
        raise InputError("its BasicTransform turns the axes, which is not supported")
    millimetres = unit_size("length", _text(calibration, "DistUnits"), "the file")
    scale = millimetres * units[0] / units[3]
    moved = [_number(transform, name, "0") * scale for name in ("Dx", "Dy", "Dz")]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[3 + i] = [
            t - moved[j] * b + moved[k] * a
            for t, a, b in zip(rows[3 + i], rows[j], rows[k], strict=True)
        ]
    return rows


def _rows(calibration: ET.Element, tag: str) -> Mapping[str, ET.Element]:
    """Return the elements of the six axes by name; empty if the file has no such elements."""
    found = {element.get("Name", ""): element for element in calibration.findall(tag)}
    missing = [name for name in _AXES if name not in found]
    if found and missing:
        raise InputError(f"it has no {tag} for {', '.join(missing)}")
    return found


def _values(element: ET.Element) -> list[float]:
    name = element.get("Name")
    values = [_finite(word, f"values of {name}") for word in element.get("values", "").split()]
    if len(values) != 6:
        raise InputError(f"its {name} has {len(values)} values, six are expected")
    return values


def _text(element: ET.Element, key: str) -> str:
    text = element.get(key)
    if not text:
        raise InputError(f"its Calibration has no {key}")
    return text


def _number(element: ET.Element, key: str, usual: str = "") -> float:
    name = element.get("Name")
    return _finite(element.get(key, usual), f"{key} of {name}" if name else key)


def _finite(text: str, name: str) -> float:
    try:
        return finite_number(text)
    except ValueError:
        raise InputError(f"its {name} is {short_message(text)!r}, not a finite number") from None


_SATURATED: Final = 0.99
"""Share of the largest voltage at which a gauge counts as saturated."""


class GaugesOptions(AtiOptions):
    """Options of ``ati-gauges``."""

    calibration_file: Path
    """The sensor's ``.cal`` file."""
    board: Driver
    """Driver and options of the board; its first six inputs are the gauges G0 to G5."""


class Gauges(WrenchSensor):
    """A `SampledSensor` of forces behind an acquisition board.

    Raises
    ------
    InputError
        The calibration cannot be used, is not the expected one, or the board has too few inputs.
    """

    OPTIONS = GaugesOptions

    def __init__(self, options: GaugesOptions) -> None:
        super().__init__(f"gauges by {options.calibration_file.name}", options)
        named = options.board
        self._board: VoltageBoard = load_device(named.driver, named.options, role="board")
        self._is_open = False
        self.loaded: FileCalibration = load_calibration_file(options.calibration_file)
        """Contents of the calibration file."""
        check_calibration(self.name, self.loaded, options)
        if self._board.inputs < 6:
            raise InputError(
                f"{self.name}: the board is set to {self._board.inputs} inputs, the gauges need six"
            )
        self._limit_v = _SATURATED * min(self.loaded.output_v, self._board.limit_v)

    def _open(self) -> None:
        self._is_open = True  # a board may hold something even if it cannot be connected
        self._board.connect()
        self._set_matrix(self.loaded.matrix, self.loaded.limits)
        self._set_latency(self._board.latency_ns)

    def close(self) -> None:
        """Close the board; calling it twice is harmless."""
        if self._is_open:
            self._is_open = False
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
        if not self._is_open:
            raise DeviceLost(f"{self.name} is closed: connect it again")
        limit_v = self._limit_v
        records: list[Stamped] = []
        for time_ns, volts in self._board.read():
            a, b, c, d, e, f = raw = volts[0], volts[1], volts[2], volts[3], volts[4], volts[5]
            if max(a, b, c, d, e, f) >= limit_v or min(raw) <= -limit_v:
                self._saturate()
            records.append((time_ns, raw))
        return records

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts of tolerated faults, by kind, those of the board too."""
        of_board = {f"board: {what}": count for what, count in self._board.faults.items() if count}
        return {**super().faults, **of_board}
