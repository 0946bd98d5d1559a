"""``mmt device``: what hardware there is, and whether it does what it should."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from mmt.cli.common import messages, output, write_json
from mmt.errors import InputError, MmtError

if TYPE_CHECKING:
    from mmt.devices.observing import Observation
    from mmt.devices.protocols import Vector
    from mmt.scene import Scene

app = typer.Typer(no_args_is_help=True, help="Look at devices.")


@app.callback()
def main() -> None:
    """Take a command."""


Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="An option of the driver; repeatable."),
]


@app.command("list")
def list_devices(
    json_file: Annotated[Path | None, typer.Option("--json", help="Write what was found.")] = None,
) -> None:
    """List drivers, serial ports and USB devices, and what is missing."""
    from mmt.devices import discovery

    drivers = discovery.find_drivers()
    table = _table("drivers", "name", "package", "factory", "state")
    for driver in drivers:
        table.add_row(driver.name, driver.package, driver.origin, driver.problem or "ready")
    output.print(table if drivers else "drivers: none but package.module:factory")
    missing = discovery.missing_libraries()
    problems = [f"{what} cannot be reached: {how}" for what, how in missing.items()]
    ports, devices = [], []
    if "serial ports" not in missing:
        ports = discovery.find_serial_ports()
    if "USB devices" not in missing:
        try:
            devices = discovery.find_usb_devices()
        except MmtError as error:
            problems.append(str(error))
    for title, found in (("serial ports", ports), ("USB devices", devices)):
        table = _table(title, "address", "what", "serial number", "state")
        for port in found:
            table.add_row(port.address, port.what, port.serial, port.problem or "accessible")
        output.print(table if found else f"{title}: none found")
    for problem in problems:
        output.print(f"- {problem}", highlight=False)
    content = {
        "drivers": [asdict(driver) for driver in drivers],
        "serial_ports": [asdict(port) for port in ports],
        "usb_devices": [asdict(device) for device in devices],
        "problems": problems,
    }
    write_json(json_file, content)


@app.command("test")
def try_devices(
    what: Annotated[
        str, typer.Argument(metavar="SCENE|DRIVER", help="A scene with devices, or a driver.")
    ],
    settings: Settings = None,
    duration: Annotated[
        float, typer.Option(min=0.1, max=3600.0, help="Seconds for each device.")
    ] = 5.0,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Take biases first; the tool is free and at rest.")
    ] = False,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
) -> None:
    """Read devices and show values, rates, jitter and faults; nothing is commanded."""
    from mmt.devices.loading import load_device
    from mmt.devices.observing import observe

    seen = []
    for role, driver, options in _devices(what, settings or []):
        device = load_device(driver, options, role=role)
        messages.print(f"{role} ({driver})", highlight=False)
        seen.append(
            observe(role, driver, device, duration_s=duration, calibrate=calibrate, show=_show)
        )
    output.print(_observation_table(seen))
    for one in seen:
        for problem in one.problems:
            output.print(f"- {one.role} ({one.driver}): {problem}", highlight=False)
    write_json(json_file, {"devices": [asdict(one) for one in seen]})
    if any(one.problems for one in seen):
        raise typer.Exit(1)


@app.command("calibrate")
def calibrate_accelerometer(
    what: Annotated[
        str, typer.Argument(metavar="SCENE|DRIVER", help="A scene with an accelerometer, or it.")
    ],
    settings: Settings = None,
    duration: Annotated[
        float, typer.Option(min=0.1, max=600.0, help="Seconds at rest in each orientation.")
    ] = 2.0,
    rests: Annotated[
        Path | None, typer.Option(help="Take recorded rests; no device is opened.")
    ] = None,
    keep: Annotated[Path | None, typer.Option(help="Keep the rests there.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
) -> None:
    """Calibrate an ADXL335 by gravity and store it under its serial number."""
    from mmt.cli.gravity import Files, calibrate_by_gravity
    from mmt.devices.loading import load_device

    found = [
        (driver, options)
        for role, driver, options in _devices(what, settings or [])
        if role in {"accelerometer", "device"}
    ]
    if not found:
        raise InputError(f"scene {what} names no accelerometer in [devices]")
    driver, options = found[0]
    files = Files(rests, keep, json_file)
    calibrate_by_gravity(load_device(driver, options), driver, duration, files)


@app.command("equalise")
def equalise_actuator(
    recording: Annotated[Path, typer.Argument(help="A .npz file of a sweep, at 1 kHz.")],
    serial: Annotated[str, typer.Option(help="Store it under this serial number.")],
    low_hz: Annotated[float, typer.Option(help="Lower end of the band.")] = 90.0,
    high_hz: Annotated[float, typer.Option(help="Upper end of the band.")] = 450.0,
    largest_gain_db: Annotated[
        float, typer.Option(help="Raise or lower a frequency by so much at most.")
    ] = 12.0,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
) -> None:
    """Fit a Haptuator's level and equaliser to a recorded sweep and store both."""
    from mmt.cli.equalising import equalise

    equalise(recording, serial, (low_hz, high_hz), largest_gain_db, json_file)


def _devices(what: str, settings: list[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield role, driver and options of what is to be tested."""
    from mmt.scene_files import example_scenes, load_scene

    options = _options(settings)
    if not (what.endswith(".toml") or what in example_scenes()):
        yield "device", what, options
        return
    if options:
        raise InputError("--set gives options to a driver: a scene has its own")
    found = list(_of_scene(load_scene(Path(what))))
    if not found:
        raise InputError(f"scene {what} names no device: add [devices], [handle] or an actuator")
    yield from found


def _of_scene(scene: "Scene") -> Iterator[tuple[str, str, dict[str, Any]]]:
    if scene.devices is not None:
        for role in ("robot", "force_sensor", "accelerometer"):
            device = getattr(scene.devices, role)
            if device is not None:
                yield role, device.driver, device.options
    if scene.handle is not None:
        yield "handle", scene.handle.driver, scene.handle.options
    if scene.actuator is not None and scene.actuator.driver is not None:
        yield "device", scene.actuator.driver, scene.actuator.options


def _options(settings: list[str]) -> dict[str, Any]:
    """Return KEY=VALUE as TOML has them; what is no TOML value is a text."""
    import tomllib

    options: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise InputError(f"--set {setting}: write KEY=VALUE")
        try:
            options[key.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            options[key.strip()] = text
    return options


def _show(seen: "Observation") -> None:
    rate = "" if seen.rate_hz is None else f", {seen.rate_hz:.0f}/s"
    messages.print(
        f"  {seen.duration_s:4.0f} s  {_numbers(seen.newest)} {seen.unit}{rate}", highlight=False
    )


def _observation_table(seen: "list[Observation]") -> Table:
    table = _table(
        "", "device", "readings", "rate", "spacing p50/p99 (ms)", "mean", "deviation", "state"
    )
    for one in seen:
        spacing = (
            "-"
            if one.spacing_p50_ms is None
            else f"{one.spacing_p50_ms:.3f} / {one.spacing_p99_ms:.3f}"
        )
        table.add_row(
            f"{one.role} ({one.driver})",
            str(one.readings),
            "polled" if one.rate_hz is None else f"{one.rate_hz:.0f} Hz",
            spacing,
            f"{_numbers(one.mean)} {one.unit}",
            _numbers(one.deviation),
            "see below" if one.problems else "good",
        )
    return table


def _numbers(vector: "Vector | None") -> str:
    return "-" if vector is None else " ".join(f"{value:.4g}" for value in vector)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title or None, title_justify="left", pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table
