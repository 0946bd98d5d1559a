"""Drivers by name and role: find them, make devices of them, and list their roles.

No driver is imported before a scene asks for it.
"""

import importlib
import inspect
from collections.abc import Iterable, Mapping
from importlib.metadata import EntryPoint
from typing import Any, Final, Literal, TypeVar, get_type_hints, overload

from pydantic import BaseModel, ValidationError

from mmt.core.errors import InputError, MmtError, located
from mmt.core.extras import optional_import
from mmt.core.plugins import not_imported, offered
from mmt.devices.protocols import (
    Accelerometer,
    ForceSensor,
    LeaderInterface,
    Robot,
    SampledSensor,
    VibrationActuator,
)
from mmt.scene.table import explain_problems

Role = Literal["robot", "force_sensor", "accelerometer", "handle", "actuator", "board"]
"""Role of a device in a scene: in ``[devices]``, as ``[handle]``, as ``[actuator]``, or as the
acquisition board of a sensor that gives bare voltages."""

ROLE_NAMES: Final[dict[Role, str]] = {
    "robot": "robot",
    "force_sensor": "force sensor",
    "accelerometer": "accelerometer",
    "handle": "handle",
    "actuator": "actuator",
    "board": "acquisition board",
}
"""Names of the roles in messages."""

GROUP: Final = "mmt.devices"
"""The group of entry points under which packages offer drivers by name."""

_FORMER: Final = {
    "adxl335-u6": 'write driver = "adxl335-board", and a table "board" below it with driver = '
    '"labjack-u6", inputs, rate_hz and box'
}
"""Former names of drivers, and what to write instead."""


def drivers() -> dict[str, dict[str, EntryPoint]]:
    """Return the entry points of all drivers, by name and by role.

    The name of an entry point ends with the role of its factory, as in ``openhaptics.handle``.
    Without a role its key is "", and the factory tells the roles.
    """
    found: dict[str, dict[str, EntryPoint]] = {}
    for name, entry in offered(GROUP).items():
        driver, _, role = name.partition(".")
        if role not in ROLE_NAMES:
            driver, role = name, ""
        found.setdefault(driver, {})[role] = entry
    return found


def entry_points_by_role(driver: str) -> dict[Role, EntryPoint]:
    """Return those of a driver's entry points that name a role, by role."""
    told = drivers().get(driver, {})
    return {role: told[role] for role in ROLE_NAMES if role in told}


def locate(driver: str, role: Role | None = None) -> str:
    """Return ``module:factory`` of a driver.

    Parameters
    ----------
    driver
        A name that an installed package offers, or ``package.module:factory``.
    role
        Wanted role of the device; None takes the driver's first role.

    Raises
    ------
    InputError
        There is no driver of that name, or it cannot take the role; the message lists others.
    """
    if ":" in driver:
        return driver
    known = drivers()
    if driver in _FORMER:
        raise InputError(f"driver {driver!r}: no longer one; {_FORMER[driver]}")
    if driver not in known:
        raise InputError(
            f"driver {driver!r} is not known; allowed are {', '.join([*sorted(known), ''])}"
            "package.module:factory, and the names that other packages offer as entry points of "
            f"{GROUP}"
        )
    targets = entry_points_by_role(driver)
    if not targets:
        return known[driver][""].value
    if role is None:
        return next(iter(targets.values())).value
    if role in targets:
        return targets[role].value
    able = [name for name in sorted(known) if role in entry_points_by_role(name)]
    raise InputError(
        f"driver {driver!r} is for {_named(targets)}, it cannot be the {ROLE_NAMES[role]}; "
        f"drivers for that are {', '.join([*able, ''])}package.module:factory, and "
        "what other packages offer"
    )


def _named(targets: Iterable[Role]) -> str:
    names = [ROLE_NAMES[role] for role in targets]
    return " or ".join(f"{'an' if name[0] in 'aeiou' else 'a'} {name}" for name in names)


Options = TypeVar("Options", bound=BaseModel)
_Options = Mapping[str, Any] | None


@overload
def load_device(driver: str, options: _Options = ..., *, role: Literal["robot"]) -> Robot: ...
@overload
def load_device(
    driver: str, options: _Options = ..., *, role: Literal["force_sensor"]
) -> ForceSensor | SampledSensor: ...
@overload
def load_device(
    driver: str, options: _Options = ..., *, role: Literal["accelerometer"]
) -> Accelerometer | SampledSensor: ...
@overload
def load_device(
    driver: str, options: _Options = ..., *, role: Literal["handle"]
) -> LeaderInterface: ...
@overload
def load_device(
    driver: str, options: _Options = ..., *, role: Literal["actuator"]
) -> VibrationActuator: ...
@overload
def load_device(driver: str, options: _Options = ..., *, role: Role | None = ...) -> Any: ...
def load_device(driver: str, options: _Options = None, *, role: Role | None = None) -> Any:
    """Import the driver's module and call its factory with the options.

    Parameters
    ----------
    driver, role
        See `mmt.devices.drivers.locate`.
    options
        Keyword arguments of the factory. A class with a pydantic model ``OPTIONS`` takes them
        as that model.

    Raises
    ------
    InputError
        There is no such driver, its module cannot be imported, or it does not take the
        options.
    MmtError
        The device cannot be made.
    """
    factory, given = load_factory(driver, role), options or {}
    model = getattr(factory, "OPTIONS", None)
    try:
        if isinstance(model, type) and issubclass(model, BaseModel):
            return factory(read_options(model, driver, given))
        _check_names(driver, factory, given)
        return factory(**given)
    except MmtError:
        raise
    except ValidationError as error:
        raise InputError(f"device {driver!r}: {explain_problems(error)}") from error
    except Exception as error:
        kind = InputError if isinstance(error, TypeError) and options else MmtError
        raise kind(f"device {driver!r} cannot be made: {located(error)}") from error


def _check_names(driver: str, factory: Any, options: Mapping[str, Any]) -> None:
    """Raise `InputError` if the options do not fit the factory's parameters."""
    try:
        signature = inspect.signature(factory)
    except (TypeError, ValueError):  # a factory in C may have no signature
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
        with optional_import():
            module = importlib.import_module(module_name)
    except InputError:
        raise
    except Exception as error:  # a driver may want a library, a file, a version of Python
        raise not_imported(f"device {driver!r}: module {module_name}", error) from error
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise InputError(f"device {driver!r}: module {module_name} has no factory {factory_name!r}")
    return factory


def read_options(model: type[Options], driver: str, options: Mapping[str, Any]) -> Options:
    """Validate a driver's options by its own pydantic model.

    Raises
    ------
    InputError
        A key or a value is not allowed; the message names it and the allowed ones.
    """
    try:
        return model.model_validate(dict(options))
    except ValidationError as error:
        raise InputError(f"device {driver!r}: {explain_problems(error, model)}") from error


def roles_of(driver: str) -> tuple[Role, ...]:
    """Return the roles of a driver, or () if they are not known.

    If its entry point names no role, the class that the factory is or returns decides: `read`
    with an argument makes a handle, `read` and `write` a robot, `read` alone a sensor, and
    `write` alone an actuator.

    Raises
    ------
    InputError
        There is no such driver, or it cannot be imported.
    """
    if roles := entry_points_by_role(driver):
        return tuple(roles)
    made = _class_of(load_factory(driver))
    reads, writes = (callable(getattr(made, name, None)) for name in ("read", "write"))
    if made is None or not (reads or writes):
        return ()
    if not reads:
        return ("actuator",)
    if len(inspect.signature(made.read).parameters) > 1:  # self and the elapsed ticks
        return ("handle",)
    return ("robot",) if writes else ("force_sensor", "accelerometer")


def role_for(driver: str, wanted: str | None) -> Role | None:
    """Return the wanted role of a driver, else its first one; None if its class leaves it open.

    Raises
    ------
    InputError
        There is no such driver, it cannot be imported, or it cannot take the wanted role.
    """
    able = roles_of(driver)
    if wanted is None:
        return able[0] if len(able) == 1 or entry_points_by_role(driver) else None
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
