"""Drivers by name and role: where they are, how a device is made of one, what each can be.

No driver is imported before a scene asks for it.
"""

import importlib
import inspect
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final, Literal, TypeVar, get_type_hints

from pydantic import BaseModel, ValidationError

from mmt.core.errors import InputError, MmtError
from mmt.core.extras import requiring
from mmt.scene.problems import explain_problems

Role = Literal["robot", "force_sensor", "accelerometer", "handle", "actuator", "board"]
"""What a device can be in a scene: in ``[devices]``, as ``[handle]``, as ``[actuator]``, or the
acquisition board of a sensor that gives bare voltages."""

ROLE_NAMES: Final[dict[Role, str]] = {
    "robot": "robot",
    "force_sensor": "force sensor",
    "accelerometer": "accelerometer",
    "handle": "handle",
    "actuator": "actuator",
    "board": "acquisition board",
}
"""As a person calls them."""

GROUP: Final = "mmt.devices"
"""The group of entry points under which another package offers its drivers by name."""

DRIVERS: Final[dict[str, Mapping[Role, str]]] = {
    "adxl335-serial": {"accelerometer": "mmt.devices.adxl335.serial_driver:SerialAdxl335"},
    "adxl335-u6": {"accelerometer": "mmt.devices.adxl335.u6_driver:U6Adxl335"},
    "ati-digital-ft": {"force_sensor": "mmt.devices.ati.digital_ft:digital_ft"},
    "ati-gauges": {"force_sensor": "mmt.devices.ati.gauges:gauges"},
    "ati-net-ft": {"force_sensor": "mmt.devices.ati.net_ft:net_ft"},
    "bota-serial": {"force_sensor": "mmt.devices.bota.driver:bota_serial"},
    "franka": {
        "robot": "mmt.devices.franka.driver:FrankaRobot",
        "force_sensor": "mmt.devices.franka.driver:FrankaForce",
    },
    "haptuator-serial": {"actuator": "mmt.devices.haptuator.serial_driver:haptuator_serial"},
    "haptuator-sound": {"actuator": "mmt.devices.haptuator.sound:haptuator_sound"},
    "iio-accelerometer": {"accelerometer": "mmt.devices.iio.driver:iio_accelerometer"},
    "inverse3": {
        "robot": "mmt.devices.haply.robot:Inverse3Robot",
        "handle": "mmt.devices.haply.handle:Inverse3Handle",
    },
    "labjack-u6": {"board": "mmt.devices.labjack.board:labjack_u6"},
    "openhaptics": {
        "robot": "mmt.devices.openhaptics.robot:OpenHapticsRobot",
        "handle": "mmt.devices.openhaptics.handle:OpenHapticsHandle",
    },
    "ur": {
        "robot": "mmt.devices.universal_robots.robot:UrRobot",
        "force_sensor": "mmt.devices.universal_robots.force:UrForceSensor",
    },
}
"""Name -> role -> ``module:factory`` of the drivers of real devices that are part of mmt."""

SOFTWARE: Final = "mmt.testing.drivers"
"""The module that registers the devices in software. Like the module of a plug-in it is imported
by its name, when it is first asked for: no driver depends on it."""


def software() -> Mapping[str, Mapping[Role, str]]:
    """Return the drivers of devices in software: name -> role -> ``module:factory``."""
    drivers: Mapping[str, Mapping[Role, str]] = importlib.import_module(SOFTWARE).DRIVERS
    return drivers


def own_roles(driver: str) -> Mapping[Role, str]:
    """Return role -> ``module:factory`` of a driver that is part of mmt, empty for another."""
    return DRIVERS.get(driver) or software().get(driver, {})


def library_file(name: str) -> str:
    """Return the file of a vendor's library: `name`, unless a library in software has that name.

    Raises
    ------
    MmtError
        The library in software cannot be made.
    """
    if not name.isidentifier():  # a path, or a file's name that the loader looks for
        return name
    libraries: Mapping[str, str] = importlib.import_module(SOFTWARE).LIBRARIES
    if name not in libraries:
        return name
    module, _, function = libraries[name].partition(":")
    return str(getattr(importlib.import_module(module), function)())


def offered() -> dict[str, EntryPoint]:
    """Return the drivers that other installed packages offer, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def locate(driver: str, role: Role | None = None) -> str:
    """Return ``module:factory`` of a driver.

    Parameters
    ----------
    driver
        A name of the table, one that an installed package offers, or ``package.module:factory``.
    role
        What the device is to be; None takes the driver's first role.

    Raises
    ------
    InputError
        There is no driver of that name, or it cannot be that; the message lists those that can.
    """
    if ":" in driver:
        return driver
    if targets := own_roles(driver):
        if role is None:
            return next(iter(targets.values()))
        if role in targets:
            return targets[role]
        raise InputError(
            f"driver {driver!r} is for {_named(targets)}, it cannot be the {ROLE_NAMES[role]}; "
            f"drivers for that are {', '.join([*_able(role), ''])}package.module:factory, and "
            "what other packages offer"
        )
    others = offered()
    if driver in others:
        return others[driver].value
    names = sorted({*DRIVERS, *software(), *others})
    raise InputError(
        f"driver {driver!r} is not known; allowed are {', '.join([*names, ''])}"
        "package.module:factory, and the names that other packages offer as entry points of "
        f"{GROUP}"
    )


def _named(targets: Mapping[Role, str]) -> str:
    names = [ROLE_NAMES[role] for role in targets]
    return " or ".join(f"{'an' if name[0] in 'aeiou' else 'a'} {name}" for name in names)


def _able(role: Role) -> list[str]:
    return [name for name, roles in {**DRIVERS, **software()}.items() if role in roles]


Options = TypeVar("Options", bound=BaseModel)


def load_device(
    driver: str, options: Mapping[str, Any] | None = None, *, role: Role | None = None
) -> Any:
    """Import the driver's module and call its factory with the options.

    Parameters
    ----------
    driver, role
        See `mmt.devices.drivers.locate`.
    options
        Keyword arguments of the factory.

    Raises
    ------
    InputError
        There is no such driver, its module cannot be imported, or it does not take the
        options.
    MmtError
        The device cannot be made.
    """
    factory = load_factory(driver, role)
    _check_names(driver, factory, options or {})
    try:
        return factory(**(options or {}))
    except MmtError:
        raise
    except ValidationError as error:
        raise InputError(f"device {driver!r}: {explain_problems(error)}") from error
    except Exception as error:
        reason = str(error) or type(error).__name__
        kind = InputError if isinstance(error, TypeError) and options else MmtError
        raise kind(f"device {driver!r} cannot be made: {reason}") from error


def _check_names(driver: str, factory: Any, options: Mapping[str, Any]) -> None:
    """Raise where a factory's own parameters do not fit the options."""
    try:
        signature = inspect.signature(factory)
    except (TypeError, ValueError):  # one in C may have none
        return
    try:
        signature.bind(**options)
    except TypeError as error:
        names = [str(parameter) for parameter in signature.parameters.values()]
        raise InputError(
            f"device {driver!r}: {error}; its options are {', '.join(names) or 'none'}"
        ) from error


def load_factory(driver: str, role: Role | None = None) -> Any:
    """Import the driver's module and return its factory; see `load_device`."""
    module_name, _, factory_name = locate(driver, role).partition(":")
    try:
        with requiring():
            module = importlib.import_module(module_name)
    except InputError:
        raise
    except Exception as error:  # a driver may want a library, a file, a version of Python
        raise InputError(
            f"device {driver!r}: module {module_name} cannot be imported ({error}); "
            "install the package that holds it, and what it needs (pip install -e DIRECTORY), or "
            "name the directory in PYTHONPATH"
        ) from error
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise InputError(f"device {driver!r}: module {module_name} has no factory {factory_name!r}")
    return factory


def read_options(model: type[Options], driver: str, options: Mapping[str, Any]) -> Options:
    """Validate a driver's options by its own pydantic model.

    Raises
    ------
    InputError
        A key or a value is not allowed; the message names it and what is.
    """
    try:
        return model.model_validate(dict(options))
    except ValidationError as error:
        raise InputError(f"device {driver!r}: {explain_problems(error, model)}") from error


def roles_of(driver: str) -> tuple[Role, ...]:
    """Return the roles of a driver, () where it does not tell.

    The driver of another package tells by its class, or by the class that its factory says it
    returns: `read` with an argument is a handle's, with `write` beside it a robot's, alone a
    sensor's; `write` alone is an actuator's.

    Raises
    ------
    InputError
        There is no such driver, or it cannot be imported.
    """
    if roles := own_roles(driver):
        return tuple(roles)
    made = _class_of(load_factory(driver))
    reads, writes = (callable(getattr(made, name, None)) for name in ("read", "write"))
    if made is None or not (reads or writes):
        return ()
    if not reads:
        return ("actuator",)
    if len(inspect.signature(made.read).parameters) > 1:  # beside self: the elapsed ticks
        return ("handle",)
    return ("robot",) if writes else ("force_sensor", "accelerometer")


def role_for(driver: str, wanted: str | None) -> Role | None:
    """Return the role to take a driver in: the wanted one, else its first, None for any sensor.

    Raises
    ------
    InputError
        There is no such driver, it cannot be imported, or it cannot be what is wanted.
    """
    able = roles_of(driver)
    if wanted is None:
        return able[0] if len(able) == 1 or own_roles(driver) else None
    allowed: tuple[Role, ...] = able or tuple(ROLE_NAMES)
    for role in allowed:
        if role == wanted.replace("-", "_").replace(" ", "_"):
            return role
    raise InputError(f"--role {wanted}: {driver} cannot be that; allowed are {', '.join(allowed)}")


def _class_of(factory: Any) -> Any:
    if inspect.isclass(factory):
        return factory
    try:
        made = get_type_hints(factory).get("return")
    except (NameError, TypeError):  # hints that only a type checker can read
        return None
    return made if inspect.isclass(made) else None
