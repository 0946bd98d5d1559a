"""``mmt device calibrate --tool``: find the load of a tool on the force sensor that carries it."""

import asyncio
import time
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.cli.common import measure_when_still, messages, output, summary_table, write_json
from mmt.cli.device_testing import devices_named, is_scene
from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.core.ticking import Ticker
from mmt.devices.calibrations import calibration_file, save_calibration
from mmt.devices.drivers import load_device
from mmt.devices.source import PERIOD_NS, DeviceSource
from mmt.devices.tool_load import CALIBRATED_AS, identify, measure_pose, with_centre
from mmt.scene.files import load_scene

_SENSORS: Final = ("force_sensor", "accelerometer")
_POSES: Final = 6
_TURNED: Final = 5
"""Duration of the turning, in durations of a pose."""


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
    calibration_file(CALIBRATED_AS, name)  # raises if the name is empty
    force_sensor, accelerometer = (_load(scene, role, settings) for role in _SENSORS)
    try:
        force_sensor.connect()
        accelerometer.connect()
        messages.print(
            "Hold the tool free in the air in six ways, each of its axes up and down once. Enter "
            "measures, s skips."
        )
        measure = partial(measure_pose, force_sensor, accelerometer, duration_s)
        prompts = (f"pose {number} of {_POSES}" for number in range(1, _POSES + 1))
        found = [measure_when_still(prompt, measure) for prompt in prompts]
    finally:
        force_sensor.close()
        accelerometer.close()
    load = identify([pose for pose in found if pose is not None])
    path = save_calibration(CALIBRATED_AS, name, load.as_dict())  # whatever the turning brings
    devices = load_scene(Path(scene)).devices
    if devices is not None and devices.tool_axes:
        turned_s = _TURNED * duration_s
        with_its_centre = measure_when_still(
            f"hold it at rest; when told, turn it free in the air for {turned_s:g} s, quickly and "
            "about each of its axes; s leaves its centre of mass out",
            lambda: with_centre(load, asyncio.run(_turned(scene, turned_s))),
        )
        if with_its_centre is not None:
            load = with_its_centre
            save_calibration(CALIBRATED_AS, name, load.as_dict())
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
