"""``mmt device calibrate``: calibrate an accelerometer by gravity, measured or recorded at rest."""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mmt.cli.common import (
    measure_when_still,
    messages,
    noting,
    output,
    raise_problems,
    summary_table,
    write_json,
)
from mmt.core.errors import InputError, MmtError
from mmt.core.existing_files import write_file
from mmt.devices.adxl335.gravity import (
    UPS,
    GravityCalibration,
    Rest,
    Up,
    calibrate,
    changes,
    check_still,
    from_dict,
    rests_from,
)
from mmt.devices.adxl335.sensor import CALIBRATED_AS, Adxl335
from mmt.devices.calibrations import calibration_file, load_calibration, save_calibration


@dataclass(frozen=True, slots=True)
class Files:
    """Files that are read and written beside the calibration."""

    rests: Path | None
    """Recorded rests to use instead of measuring, or None."""
    keep: Path | None
    """File for the measured rests, or None."""
    json: Path | None


def calibrate_by_gravity(device: Any, driver: str, duration_s: float, files: Files) -> None:
    """Measure or read rests, fit, compare with the stored calibration, and store.

    Parameters
    ----------
    device, driver
        An ADXL335, and the name of its driver.
    duration_s
        Duration of each rest.
    files
        See `Files`.

    Raises
    ------
    InputError
        The device is not an ADXL335 or has no serial number, the rests do not determine the
        calibration, or they cannot be kept. In the last case the calibration has been stored.
    """
    if not isinstance(device, Adxl335):
        raise InputError(
            f"{driver} is not calibrated by gravity: that is for a real ADXL335, by the drivers "
            "adxl335-serial and adxl335-board"
        )
    problems: list[Exception] = []
    if files.rests is not None:
        serial, rests = _read(files.rests, device.named)
    else:
        serial, rests = _measure(device, duration_s)
        with noting(problems):  # a file that cannot be written must not cost the measurement
            _keep(files.keep, serial, rests)
    made = calibrate(rests, device.supply_v)
    moved = _changes(serial, made)
    path = save_calibration(CALIBRATED_AS, serial, made.as_dict())
    output.print(summary_table(f"ADXL335 {serial}", {"calibration": made.as_dict()}))
    for sentence in moved:
        output.print(f"- changed since the last time: {sentence}")
    messages.print(f"stored: {path}")
    figures = {"serial": serial, "file": str(path), **made.as_dict(), "changes": moved}
    write_json(files.json, {**figures, "rests": [rest._asdict() for rest in rests]})
    raise_problems(problems)


def _measure(sensor: Adxl335, duration_s: float) -> tuple[str, list[Rest]]:
    """Prompt for each orientation and measure it."""
    sensor.connect()
    try:
        calibration_file(CALIBRATED_AS, sensor.serial_number)  # raises if there is no serial number
        messages.print(
            "Put the sensor against something upright in six ways. Enter measures, s skips; "
            "each axis is needed once, all six are best."
        )
        found = [
            measure_when_still(
                f"{up[1]} points {'up' if up[0] == '+' else 'down'}",
                partial(_rest, sensor, up, duration_s),
            )
            for up in UPS
        ]
        return sensor.serial_number, [rest for rest in found if rest is not None]
    finally:
        sensor.close()


def _rest(sensor: Adxl335, up: Up, duration_s: float) -> Rest:
    """Measure one orientation, and raise `InputError` if the sensor moved."""
    rest = sensor.measure_rest(up, duration_s)
    check_still(rest, sensor.supply_v)
    return rest


def _read(path: Path, named: str | None) -> tuple[str, list[Rest]]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"--rests {path}: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"--rests {path}: not valid JSON: {error}") from error
    if not isinstance(content, dict) or "rests" not in content:
        raise InputError(f'--rests {path}: it must hold "rests", and may hold "serial"')
    serial = named or str(content.get("serial") or "")
    calibration_file(CALIBRATED_AS, serial)
    return serial, rests_from(content["rests"])


def _keep(path: Path | None, serial: str, rests: list[Rest]) -> None:
    if path is None:
        return
    text = json.dumps({"serial": serial, "rests": [rest._asdict() for rest in rests]}, indent=2)
    write_file(path, text + "\n")


def _changes(serial: str, made: GravityCalibration) -> list[str]:
    """Describe the changes from the stored calibration, or why that cannot be compared."""
    try:
        stored = load_calibration(CALIBRATED_AS, serial)
        return [] if stored is None else changes(made, from_dict(stored))
    except MmtError as error:
        return [f"the one before cannot be compared: {error}"]
