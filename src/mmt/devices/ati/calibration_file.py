"""ATI's ``.cal`` file: the matrix from six gauge voltages to forces and torques."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mmt.core.bounds import finite_number
from mmt.core.errors import InputError, short_message
from mmt.core.xml_files import parse_xml
from mmt.devices.ati.calibration import (
    Calibration,
    force_in_newton,
    length_in_mm,
    torque_in_newton_mm,
)
from mmt.devices.wrench import Matrix, matrix_of

_AXES: Final = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
_LARGEST: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class FileCalibration:
    """Contents of a ``.cal`` file."""

    calibration: Calibration
    matrix: Matrix
    """From volts to N and N mm."""
    output_v: float
    """Largest magnitude of the amplifier's output voltage."""


def load_calibration_file(path: Path) -> FileCalibration:
    """Read a ``.cal`` file.

    Raises
    ------
    InputError
        The file cannot be read or used; the message says why.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
    except OSError as error:
        raise InputError(
            f"calibration {path}: {error.strerror or error}; it came with the sensor, under the "
            "name of its serial number"
        ) from error
    if len(content) > _LARGEST:
        raise InputError(f"calibration {path}: over 1 MiB, so it is no .cal file")
    try:
        return parse_calibration_file(content)
    except InputError as error:
        raise InputError(f"calibration {path}: {error}") from error


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
    if float(_number(calibration.get("GainMultiplier", "1"), "GainMultiplier")) != 1.0:
        raise InputError("its GainMultiplier is not 1, which is not supported")
    newton = force_in_newton(_text(calibration, "ForceUnits"), "the file")
    newton_mm = torque_in_newton_mm(_text(calibration, "TorqueUnits"), "the file")
    axes = _rows(calibration, "UserAxis")
    rows = (
        [_numbers(axes[name], "values") for name in _AXES]
        if axes
        else _from_axes(calibration, newton, newton_mm)
    )
    ranges = axes or _rows(calibration, "Axis")
    units = [newton] * 3 + [newton_mm] * 3
    x, y, z, tx, ty, tz = (
        unit * _number(ranges[name].get("max", ""), f"max of {name}")
        for name, unit in zip(_AXES, units, strict=True)
    )
    if min(x, y, z, tx, ty, tz) <= 0:
        raise InputError("its ranges 'max' are not above zero")
    try:
        matrix = matrix_of(
            [[unit * value for value in row] for row, unit in zip(rows, units, strict=True)]
        )
    except ValueError as error:
        raise InputError(f"its matrix cannot be used: {error}") from None
    output = _number(calibration.get("OutputRange", "20"), "OutputRange")
    bipolar = calibration.get("OutputBipolar", "True").lower() == "true"
    return FileCalibration(
        Calibration(
            serial=root.get("Serial", ""),
            part=calibration.get("PartNumber", ""),
            force_unit=_text(calibration, "ForceUnits"),
            range_n=(x, y, z),
            range_n_mm=(tx, ty, tz),
        ),
        matrix,
        output / 2 if bipolar else output,
    )


def _from_axes(calibration: ET.Element, newton: float, newton_mm: float) -> list[list[float]]:
    """Return the rows of a file without ``UserAxis``, in the file's own units."""
    axes = _rows(calibration, "Axis")
    if not axes:
        raise InputError("it has neither UserAxis nor Axis rows")
    rows = []
    for name in _AXES:
        scale = _number(axes[name].get("scale", ""), f"scale of {name}")
        if scale == 0:
            raise InputError(f"its scale of {name} is zero")
        rows.append([value / scale for value in _numbers(axes[name], "values")])
    transform = calibration.find("BasicTransform")
    if transform is None:
        return rows
    if any(_number(transform.get(angle, "0"), angle) != 0 for angle in ("Rx", "Ry", "Rz")):
        raise InputError("its BasicTransform turns the axes, which is not supported")
    millimetres = length_in_mm(_text(calibration, "DistUnits"), "the file")
    dx, dy, dz = (
        _number(transform.get(name, "0"), name) * millimetres * newton / newton_mm
        for name in ("Dx", "Dy", "Dz")
    )
    fx, fy, fz, tx, ty, tz = rows
    return [
        fx,
        fy,
        fz,
        [t - dy * c + dz * b for t, b, c in zip(tx, fy, fz, strict=True)],
        [t - dz * a + dx * c for t, a, c in zip(ty, fx, fz, strict=True)],
        [t - dx * b + dy * a for t, a, b in zip(tz, fx, fy, strict=True)],
    ]


def _rows(calibration: ET.Element, tag: str) -> Mapping[str, ET.Element]:
    """Return the elements of the six axes by name; empty if the file has no such elements."""
    found = {element.get("Name", ""): element for element in calibration.findall(tag)}
    missing = [name for name in _AXES if name not in found]
    if found and missing:
        raise InputError(f"it has no {tag} for {', '.join(missing)}")
    return found


def _numbers(element: ET.Element, key: str) -> Sequence[float]:
    name = element.get("Name", "")
    values = [_number(word, f"{key} of {name}") for word in element.get(key, "").split()]
    if len(values) != 6:
        raise InputError(f"its {name} has {len(values)} values, six are expected")
    return values


def _text(element: ET.Element, key: str) -> str:
    text = element.get(key)
    if not text:
        raise InputError(f"its Calibration has no {key}")
    return text


def _number(text: str, name: str) -> float:
    try:
        return finite_number(text)
    except ValueError:
        raise InputError(f"its {name} is {short_message(text)!r}, not a finite number") from None
