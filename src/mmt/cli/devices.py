"""``mmt device``: list, test and calibrate devices."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from mmt.cli.common import Force, json_option, output, write_json
from mmt.cli.device.options import EqualisingOptions
from mmt.cli.main import command_group
from mmt.cli.options import with_options
from mmt.core.errors import InputError, MmtError
from mmt.core.files.existing import require_absent
from mmt.core.output.tables import plain_table

if TYPE_CHECKING:
    from mmt.devices.discovery import FoundDriver, FoundPort

app = command_group("List, test and calibrate devices.")


Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="An option of the driver; repeatable."),
]


@app.command("list")
def list_devices(
    json_file: Annotated[Path | None, json_option("Write what was found.")] = None,
) -> None:
    """List drivers, ports, USB and IIO devices and sound outputs, and what is missing."""
    from mmt.devices.discovery import find_all, find_drivers

    drivers = find_drivers()
    wanting: dict[str, list[str]] = {}
    for driver in drivers:
        if driver.problem:
            wanting.setdefault(driver.problem, []).append(driver.name)
    output.print(_driver_table(drivers))
    for driver in drivers:
        if driver.rates:
            output.print(f"{driver.name}: {driver.rates}")
    found: dict[str, list[FoundPort]] = {}
    for title, find in find_all().items():
        try:
            found[title] = find()
        except MmtError as error:
            found[title] = []
            wanting.setdefault(str(error), []).append(title)
            output.print(f"{title}: not known, see below")
        else:
            _print_ports(title, found[title])
            for port in found[title]:
                if port.problem:
                    wanting.setdefault(port.problem, []).append(port.address)
    problems = [f"{', '.join(names)}: {problem}" for problem, names in wanting.items()]
    if problems:
        output.print("what is missing; install what you need:")
    for problem in problems:
        output.print(f"- {problem}")
    write_json(
        json_file,
        {
            "drivers": [asdict(driver) for driver in drivers],
            **{
                title.lower().replace(" ", "_"): [asdict(each) for each in ports]
                for title, ports in found.items()
            },
            "problems": problems,
        },
    )


def _driver_table(drivers: "list[FoundDriver]") -> Table:
    from mmt.devices.drivers import ROLE_NAMES

    table = plain_table("drivers", "name", "is", "package", "state")
    for driver in drivers:
        roles = " or ".join(ROLE_NAMES[role] for role in driver.roles) or "does not tell"
        state = "see below" if driver.problem else "ready"
        table.add_row(driver.name, roles, driver.package, state)
    return table


def _print_ports(title: str, ports: "list[FoundPort]") -> None:
    if not ports:
        output.print(f"{title}: none found")
        return
    table = plain_table(title, "address", "what", "serial number", "state")
    for port in ports:
        state = "see below" if port.problem else "accessible"
        table.add_row(port.address, port.what, port.serial or "-", state)
    output.print(table)


@app.command("test")
def try_devices(
    what: Annotated[
        str, typer.Argument(metavar="SCENE|DRIVER", help="A scene with devices, or a driver.")
    ],
    settings: Settings = None,
    role: Annotated[
        str | None,
        typer.Option(
            help="robot, force_sensor, accelerometer, handle, actuator or board: of a scene "
            "test this device alone, take a driver as this."
        ),
    ] = None,
    duration: Annotated[
        float, typer.Option(min=0.1, max=3600.0, help="Seconds for each device.")
    ] = 5.0,
    calibrate: Annotated[
        bool, typer.Option("--calibrate", help="Take biases first; the tool is free and at rest.")
    ] = False,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
) -> None:
    """Read devices and show values, rates, jitter and faults; nothing moves or sounds."""
    from mmt.cli.device.testing import devices_named, observe_all

    devices = devices_named(what, role, settings or [])
    if not observe_all(devices, duration, calibrate=calibrate, json_file=json_file):
        raise typer.Exit(1)


@app.command("calibrate")
def calibrate_accelerometer(
    what: Annotated[
        str,
        typer.Argument(
            metavar="SCENE|DRIVER", help="A scene with an accelerometer, or its driver."
        ),
    ],
    settings: Settings = None,
    duration: Annotated[
        float, typer.Option(min=0.1, max=600.0, help="Seconds at rest in each orientation.")
    ] = 2.0,
    rests: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Take the rests of this file; no device is opened."),
    ] = None,
    keep: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep the measured rests, for --rests.")
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Find the load of the scene's tool instead, and store it by name."
        ),
    ] = None,
    force: Force = False,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
) -> None:
    """Calibrate an ADXL335, or the load of a tool on its force sensor, by gravity; store it."""
    from mmt.cli.device.calibrating import calibrate_by_gravity, calibrate_tool
    from mmt.cli.device.testing import devices_named, is_scene
    from mmt.devices.drivers import load_device

    if tool is not None:
        if rests is not None or keep is not None:
            raise InputError("--tool goes without --rests and --keep")
        calibrate_tool(what, settings or [], tool, duration, json_file)
        return
    if keep is not None:
        require_absent(keep, force=force)
    role = "accelerometer" if is_scene(what) else None
    named = devices_named(what, role, settings or [])[0]
    device = load_device(named.driver, named.options, role=named.role)
    calibrate_by_gravity(device, named.driver, duration, rests, keep, json_file)


@app.command("equalise")
@with_options
def equalise_actuator(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="RECORDING.npz|SCENE",
            help="A recorded sweep, or a scene with the actuator and accelerometer to make one.",
        ),
    ] = None,
    *,
    options: EqualisingOptions,
) -> None:
    """Fit a Haptuator's level and equaliser to a sweep, recorded or played now; store both."""
    from mmt.cli.device.equalising import equalise

    if options.keep is not None:
        require_absent(options.keep, force=options.force)
    equalise(what, options)
