"""``mmt device calibrate``: an accelerometer, or the load of a tool, by gravity and at rest."""

import asyncio
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import typer

from mmt.cli.common import messages, noting, output, raise_problems, summary_table, write_json
from mmt.cli.device.testing import devices_named, is_scene
from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError, MmtError, naming
from mmt.core.files.existing import write_file
from mmt.core.files.untrusted import parsed_json
from mmt.core.running.ticking import Ticker
from mmt.devices.adxl335 import sensor as adxl335
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
from mmt.devices.calibrations import (
    calibration_file,
    load_calibration,
    require_storable,
    save_calibration,
)
from mmt.devices.drivers import load_device
from mmt.devices.streaming import tool_load
from mmt.devices.streaming.source import PERIOD_NS, DeviceSource
from mmt.scene.files import load_scene

_SENSORS: Final = ("force_sensor", "accelerometer")
_POSES: Final = 6
_TURNED: Final = 5
"""Duration of the turning, in durations of a pose."""

Measured = TypeVar("Measured")


def calibrate_by_gravity(
    device: Any,
    driver: str,
    duration_s: float,
    recorded: Path | None,
    keep: Path | None,
    json_file: Path | None,
) -> None:
    """Measure or read rests, fit, compare with the stored calibration, and store.

    Parameters
    ----------
    device, driver
        An ADXL335, and the name of its driver.
    duration_s
        Duration of each rest.
    recorded
        File of rests to use instead of measuring, or None.
    keep, json_file
        Files for the measured rests and for the figures, or None.

    Raises
    ------
    InputError
        The device is not an ADXL335 or has no serial number, the rests do not determine the
        calibration, or they cannot be kept. In the last case the calibration has been stored.
    """
    if not isinstance(device, adxl335.Adxl335):
        raise InputError(
            f"{driver} is not calibrated by gravity: that is for a real ADXL335, by the drivers "
            "adxl335-serial and adxl335-board"
        )
    problems: list[Exception] = []
    if recorded is not None:
        serial, rests = _read(recorded, device.named)
    else:
        serial, rests = _measure(device, duration_s)
        with noting(problems):  # a file that cannot be written must not cost the measurement
            _keep(keep, serial, rests)
    made = calibrate(rests, device.supply_v)
    moved = _changes(serial, made)
    path = save_calibration(adxl335.CALIBRATED_AS, serial, made.as_dict())
    output.print(summary_table(f"ADXL335 {serial}", {"calibration": made.as_dict()}))
    for sentence in moved:
        output.print(f"- changed since the last time: {sentence}")
    messages.print(f"stored: {path}")
    figures = {"serial": serial, "file": str(path), **made.as_dict(), "changes": moved}
    write_json(json_file, {**figures, "rests": [rest._asdict() for rest in rests]})
    raise_problems(problems)


def _measure(sensor: adxl335.Adxl335, duration_s: float) -> tuple[str, list[Rest]]:
    """Prompt for each orientation and measure it."""
    sensor.connect()
    try:
        require_storable(adxl335.CALIBRATED_AS, sensor.serial_number)
        messages.print(
            "Put the sensor against something upright in six ways. Enter measures, s skips; "
            "each axis is needed once, all six are best."
        )
        found = [
            _measure_when_still(
                f"{up[1]} points {'up' if up[0] == '+' else 'down'}",
                partial(_rest, sensor, up, duration_s),
            )
            for up in UPS
        ]
        return sensor.serial_number, [rest for rest in found if rest is not None]
    finally:
        sensor.close()


def _rest(sensor: adxl335.Adxl335, up: Up, duration_s: float) -> Rest:
    """Measure one orientation, and raise `InputError` if the sensor moved."""
    rest = sensor.measure_rest(up, duration_s)
    check_still(rest, sensor.supply_v)
    return rest


def _read(path: Path, named: str | None) -> tuple[str, list[Rest]]:
    with naming(f"--rests {path}"):
        content = parsed_json(path.read_bytes(), "it")
        if not isinstance(content, dict) or "rests" not in content:
            raise InputError('it must hold "rests", and may hold "serial"')
    serial = named or str(content.get("serial") or "")
    calibration_file(adxl335.CALIBRATED_AS, serial)
    return serial, rests_from(content["rests"])


def _keep(path: Path | None, serial: str, rests: list[Rest]) -> None:
    if path is None:
        return
    text = json.dumps({"serial": serial, "rests": [rest._asdict() for rest in rests]}, indent=2)
    write_file(path, text + "\n")


def _changes(serial: str, made: GravityCalibration) -> list[str]:
    """Describe the changes from the stored calibration, or why that cannot be compared."""
    try:
        stored = load_calibration(adxl335.CALIBRATED_AS, serial)
        return [] if stored is None else changes(made, from_dict(stored))
    except MmtError as error:
        return [f"the one before cannot be compared: {error}"]


def calibrate_tool(
    scene: str, settings: list[str], name: str, duration_s: float, json_file: Path | None
) -> None:
    """Prompt for six poses, measure them, identify the load, and store it.

    If the scene names `tool_axes`, the tool is then turned for its centre of mass.

    Parameters
    ----------
    scene
        A scene with a force sensor and an accelerometer.
    settings
        Options for a driver, which a scene refuses.
    name
        Name under which the load is stored, for ``tool`` of ``[devices]``.
    duration_s
        Duration of each pose.
    json_file
        File for the figures, or None.

    Raises
    ------
    InputError
        It is no scene with both sensors, or the poses do not determine the load.
    """
    if not is_scene(scene):
        raise InputError(f"--tool takes a scene with both sensors; {scene} is a driver")
    require_storable(tool_load.CALIBRATED_AS, name)
    force_sensor, accelerometer = (_load(scene, role, settings) for role in _SENSORS)
    try:
        force_sensor.connect()
        accelerometer.connect()
        messages.print(
            "Hold the tool free in the air in six ways, each of its axes up and down once. Enter "
            "measures, s skips."
        )
        measure = partial(tool_load.measure_pose, force_sensor, accelerometer, duration_s)
        prompts = (f"pose {number} of {_POSES}" for number in range(1, _POSES + 1))
        found = [_measure_when_still(prompt, measure) for prompt in prompts]
    finally:
        force_sensor.close()
        accelerometer.close()
    load = tool_load.identify([pose for pose in found if pose is not None])
    # whatever the turning brings
    path = save_calibration(tool_load.CALIBRATED_AS, name, load.as_dict())
    devices = load_scene(Path(scene)).devices
    if devices is not None and devices.tool_axes:
        turned_s = _TURNED * duration_s
        with_its_centre = _measure_when_still(
            f"hold it at rest; when told, turn it free in the air for {turned_s:g} s, quickly and "
            "about each of its axes; s leaves its centre of mass out",
            lambda: tool_load.with_centre(load, asyncio.run(_turned(scene, turned_s))),
        )
        if with_its_centre is not None:
            load = with_its_centre
            save_calibration(tool_load.CALIBRATED_AS, name, load.as_dict())
    figures = {"mass_g": 1e3 * load.mass_kg, "residual_n": load.residual_n}
    for axis, place_m in zip("xyz", load.centre_m or (), strict=False):
        figures[f"centre_{axis}_mm"] = 1e3 * place_m
    output.print(summary_table(f"tool {name}", {"load": figures}))
    messages.print(f"stored: {path}")
    write_json(json_file, {"tool": name, "file": str(path), **load.as_dict()})


def _load(scene: str, role: str, settings: list[str]) -> Any:
    (named,) = devices_named(scene, role, settings)
    return load_device(named.driver, named.options, role=named.role)


async def _turned(scene: str, duration_s: float) -> RecordArray:
    """Return frames (n,) of the tool while it is turned; the robot is not moved."""
    robot, force, acceleration = (_load(scene, role, []) for role in ("robot", *_SENSORS))
    source = DeviceSource(robot, force, acceleration, ("force", "acceleration", "orientation"))
    frames: list[RecordArray] = []

    def tick(elapsed: int) -> None:
        frames.append(source.step(elapsed, time.monotonic_ns(), None))

    try:
        source.open()
        messages.print(f"now turn it, for {duration_s:g} s")
        source.start(time.monotonic_ns())
        ticker = Ticker(PERIOD_NS, tick, statistics=False)
        ticker.start()
        ended = asyncio.ensure_future(ticker.wait())
        await asyncio.wait([ended], timeout=duration_s)
        ticker.stop()
        await ended
    finally:
        source.close()
    return np.concatenate(frames)


def _measure_when_still(prompt: str, measure: Callable[[], Measured]) -> Measured | None:
    """Prompt, and measure after Enter, again while `InputError` says why not; None after s."""
    while True:
        answer = typer.prompt(prompt, default="", show_default=False, err=True)
        if str(answer).strip().lower() == "s":
            return None
        try:
            return measure()
        except InputError as error:
            messages.print(str(error))
