"""``mmt device equalise``: fit and store level and equaliser, from a sweep recorded or played."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mmt.cli.common import messages, noting, output, raise_problems, write_json
from mmt.cli.device.options import EqualisingOptions
from mmt.cli.device.testing import devices_named, options_from
from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.files.existing import replacing
from mmt.core.files.untrusted import load_arrays
from mmt.devices.calibrations import require_storable
from mmt.devices.drivers import load_device
from mmt.devices.haptuator.driver import DEVICE, store_level
from mmt.devices.haptuator.equaliser import fit_equaliser
from mmt.devices.haptuator.sweep import SweepRecording, SweepSettings, record_sweep

_NAMES = ("drive_v", "acceleration_m_s2")
_BUFFER_MS = 60.0
"""Default latency of the actuator during the sweep, long to avoid gaps."""
_MARGIN_HZ = (30.0, 40.0)
"""Margins of the sweep below and above the band that is equalised."""
_EDGES_HZ = (20.0, 495.0)


def equalise(what: str | None, options: EqualisingOptions) -> None:
    """Read a recording, or play and record a sweep; fit, show and store.

    Raises
    ------
    InputError
        The recording, the scene or a driver cannot be used, or the recording cannot be kept. In
        the last case, level and equaliser have been stored.
    MmtError
        A device fails, or the calibration cannot be written.
    """
    problems: list[Exception] = []
    if what is not None and not what.endswith(".toml") and Path(what).suffix:
        _refuse_live(options)
        serial = options.serial
        if serial is None:
            raise InputError("--serial is missing: under which name is it to be stored?")
        volts, acceleration = _read(Path(what))
        played = {}
    else:
        serial, recording = _record(what, options)
        with noting(problems):
            _keep(options.keep, recording)
        volts, acceleration = recording.volts, recording.acceleration_m_s2
        played = {"level_v": recording.level_v, "peak_m_s2": recording.peak_m_s2}
    fitted = fit_equaliser(
        volts,
        acceleration,
        low_hz=options.low_hz,
        high_hz=options.high_hz,
        largest_gain_db=options.largest_gain_db,
    )
    path = store_level(fitted, serial)
    output.print(
        f"Haptuator {serial}: {fitted.volts_per_m_s2:.4g} V for 1 m/s2; uneven by "
        f"{fitted.unevenness_db:.1f} dB from {fitted.low_hz:.0f} to {options.high_hz:g} Hz, evened "
        f"out to {fitted.remaining_db:.1f} dB; coherence {fitted.coherence:.3f}"
    )
    output.print(f"stored in {path}", soft_wrap=True)
    output.print(f'the drivers take it by: serial = "{serial}"')
    figures = {**asdict(fitted), "serial": serial, "file": str(path), **played}
    write_json(options.json_file, figures)
    raise_problems(problems)


def _refuse_live(options: EqualisingOptions) -> None:
    given = {
        "--actuator": options.actuator,
        "--accelerometer": options.accelerometer,
        "--set": options.settings or None,
        "--level-v": options.level_v,
        "--keep": options.keep,
    }
    for option, value in given.items():
        if value is not None:
            raise InputError(f"{option} is for a sweep that is played now: a recording was given")


def _record(scene: str | None, options: EqualisingOptions) -> tuple[str, SweepRecording]:
    """Play and record; return the serial number and the recording."""
    given = _options_of(options.settings or [])
    actuator, actuator_options = _chosen("actuator", scene, options.actuator, given)
    accelerometer, sensor_options = _chosen("accelerometer", scene, options.accelerometer, given)
    stored_as = actuator_options.pop("serial", None)
    serial = options.serial or stored_as
    if serial is None:
        raise InputError("--serial is missing: under which name is it to be stored?")
    require_storable(DEVICE, str(serial))
    level = {"volts_per_m_s2": 1.0}  # not used: the sweep is in volts
    played = {"buffer_ms": _BUFFER_MS, **actuator_options, **level}
    below, above = _MARGIN_HZ
    recording = record_sweep(
        load_device(actuator, played, role="actuator"),
        load_device(accelerometer, sensor_options, role="accelerometer"),
        SweepSettings(
            low_hz=max(_EDGES_HZ[0], (options.low_hz or 0.0) - below),
            high_hz=min(_EDGES_HZ[1], options.high_hz + above),
            duration_s=options.duration,
            largest_m_s2=options.largest_m_s2,
            level_v=options.level_v,
        ),
        messages.print,
    )
    return str(serial), recording


def _options_of(settings: list[str]) -> dict[str, dict[str, Any]]:
    """Return the options of each device from ``ROLE.KEY=VALUE``."""
    found: dict[str, dict[str, Any]] = {"actuator": {}, "accelerometer": {}}
    for name, value in options_from(settings).items():
        role, _, key = name.partition(".")
        if role not in found or not key:
            raise InputError(
                f"--set {name}: write actuator.KEY=VALUE or accelerometer.KEY=VALUE here"
            )
        found[role][key] = value
    return found


def _chosen(
    role: str, scene: str | None, driver: str | None, options: dict[str, dict[str, Any]]
) -> tuple[str, dict[str, Any]]:
    """Return driver and options of the actuator or the accelerometer."""
    if driver is not None:
        return driver, options[role]
    if scene is None:
        raise InputError(f"give a recording, a scene, or the driver by --{role}")
    named = devices_named(scene, role, [])[0]
    return named.driver, {**named.options, **options[role]}


def _keep(path: Path | None, recording: SweepRecording) -> None:
    if path is None:
        return
    arrays = dict(zip(_NAMES, (recording.volts, recording.acceleration_m_s2), strict=True))
    with replacing(path) as part, part.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _read(recording: Path) -> tuple[FloatArray, FloatArray]:
    try:
        arrays, _ = load_arrays(recording)
        volts, acceleration = (np.asarray(arrays[name], dtype=np.float64) for name in _NAMES)
    except (InputError, OSError, KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{recording} cannot be read ({error}): it must be a .npz file with the arrays "
            f"{' and '.join(_NAMES)}, at 1 kHz"
        ) from error
    return volts, acceleration
