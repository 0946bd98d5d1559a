"""Calibrations of single devices, kept between runs: a JSON file for each serial number.

They lie in the user's data directory (``~/.local/share/mmt-haptics/calibrations`` on Linux),
since a calibration belongs to a device on a bench and not to a scene.
"""

import json
import re
import tempfile
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any

import platformdirs

from mmt.core.arrays import Vector
from mmt.core.errors import InputError, MmtError, naming
from mmt.core.files.existing import write_file
from mmt.core.files.untrusted import parsed_json


def calibration_file(device: str, serial: str) -> Path:
    """Return the path of a device's calibration, whether or not the file exists.

    Parameters
    ----------
    device
        The kind of device, as ``adxl335``.
    serial
        Its serial number; characters that are not allowed in a file's name become ``_``.

    Raises
    ------
    InputError
        The serial number is empty.
    """
    if not serial.strip():
        raise InputError(f"the {device} has no serial number: give it one with the option 'serial'")
    directory = platformdirs.user_data_path("mmt-haptics", appauthor=False) / "calibrations"
    return directory / f"{_plain(device)}-{_plain(serial)}.json"


def require_storable(device: str, serial: str) -> None:
    """Raise unless a calibration can be stored, before somebody has turned or played for it.

    Raises
    ------
    InputError
        The serial number is empty, or the folder may not be written to.
    """
    path = calibration_file(device, serial)
    with naming(f"cannot write {path}"):
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()


def load_calibration(device: str, serial: str) -> dict[str, Any] | None:
    """Return the stored calibration, or None.

    Raises
    ------
    MmtError
        The file is there but cannot be read.
    """
    path = calibration_file(device, serial)
    try:
        content = parsed_json(path.read_bytes(), "it")
    except FileNotFoundError:
        return None
    except (OSError, InputError) as error:
        raise MmtError(
            f"the calibration {path} cannot be read ({error}): calibrate again or delete the file"
        ) from error
    if not isinstance(content, dict) or content.get("serial") != serial:
        raise MmtError(
            f"the calibration {path} is not that of {device} {serial}: calibrate again or delete "
            "the file"
        )
    return content


def save_calibration(device: str, serial: str, values: Mapping[str, Any]) -> Path:
    """Store a calibration with the device's name and serial number; return its file.

    Raises
    ------
    InputError, MmtError
        The file cannot be written.
    """
    path = calibration_file(device, serial)
    content = {**values, "device": device, "serial": serial}
    write_file(path, json.dumps(content, indent=2) + "\n")
    return path


def finite_vector(values: Any) -> Vector:
    """Return three values as a vector.

    Raises
    ------
    TypeError, ValueError
        They are not three finite numbers.
    """
    x, y, z = (float(value) for value in values)
    if not (isfinite(x) and isfinite(y) and isfinite(z)):
        raise ValueError(f"{values}: not finite")
    return x, y, z


def _plain(text: str) -> str:
    return re.sub(r"[^\w.-]", "_", text.strip())
