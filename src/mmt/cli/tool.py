"""``mmt device calibrate --tool``: find the load of a tool on the force sensor that carries it."""

from functools import partial
from pathlib import Path
from typing import Any, Final

from mmt.cli.common import measure_when_still, messages, output, summary_table, write_json
from mmt.cli.device_testing import devices_named, is_scene
from mmt.core.errors import InputError
from mmt.devices.calibrations import calibration_file, save_calibration
from mmt.devices.drivers import load_device
from mmt.devices.tool_load import CALIBRATED_AS, identify, measure_pose

_POSES: Final = 6


def calibrate_tool(
    scene: str, settings: list[str], name: str, duration_s: float, json_file: Path | None
) -> None:
    """Prompt for six poses, measure them, identify the load, and store it.

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
    sensors: list[Any] = [
        load_device(named.driver, named.options, role=named.role)
        for role in ("force_sensor", "accelerometer")
        for named in devices_named(scene, role, settings)[:1]
    ]
    force_sensor, accelerometer = sensors
    try:
        force_sensor.connect()
        accelerometer.connect()
        messages.print(
            "Hold the tool free in the air in six ways, each of its axes up and down once. Enter "
            "measures, s skips.",
            highlight=False,
        )
        measure = partial(measure_pose, force_sensor, accelerometer, duration_s)
        prompts = (f"pose {number} of {_POSES}" for number in range(1, _POSES + 1))
        found = [measure_when_still(prompt, measure) for prompt in prompts]
    finally:
        force_sensor.close()
        accelerometer.close()
    load = identify([pose for pose in found if pose is not None])
    path = save_calibration(CALIBRATED_AS, name, load.as_dict())
    figures = {"mass_g": 1e3 * load.mass_kg, "residual_n": load.residual_n}
    output.print(summary_table(f"tool {name}", {"load": figures}))
    messages.print(f"stored: {path}", highlight=False)
    write_json(json_file, {"tool": name, "file": str(path), **load.as_dict()})
