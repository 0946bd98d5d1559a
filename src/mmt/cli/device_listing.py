"""``mmt device list``: drivers, ports and cards, and what is missing."""

from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from mmt.cli.common import output, write_json
from mmt.core.errors import MmtError
from mmt.core.tables import plain_table
from mmt.devices import discovery
from mmt.devices.drivers import ROLE_NAMES


def list_all(json_file: Path | None) -> None:
    """Show drivers, ports and cards, and their problems."""
    drivers = discovery.find_drivers()
    wanting: dict[str, list[str]] = {}
    for driver in drivers:
        if driver.problem:
            wanting.setdefault(driver.problem, []).append(driver.name)
    output.print(_driver_table(drivers))
    for driver in drivers:
        if driver.rates:
            output.print(f"{driver.name}: {driver.rates}")
    found: dict[str, list[discovery.FoundPort]] = {}
    for title, find in discovery.find_all().items():
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


def _driver_table(drivers: "list[discovery.FoundDriver]") -> Table:
    table = plain_table("drivers", "name", "is", "package", "state")
    for driver in drivers:
        roles = " or ".join(ROLE_NAMES[role] for role in driver.roles) or "does not tell"
        state = "see below" if driver.problem else "ready"
        table.add_row(driver.name, roles, driver.package, state)
    return table


def _print_ports(title: str, ports: "list[discovery.FoundPort]") -> None:
    if not ports:
        output.print(f"{title}: none found")
        return
    table = plain_table(title, "address", "what", "serial number", "state")
    for port in ports:
        state = "see below" if port.problem else "accessible"
        table.add_row(port.address, port.what, port.serial or "-", state)
    output.print(table)
