"""Which roles a driver can take: by the table for mmt's own, else by the calls that it has."""

import inspect
from typing import Any, get_type_hints

from mmt.core.errors import InputError
from mmt.devices.loading import load_factory
from mmt.devices.table import DRIVERS, ROLE_NAMES, Role


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
    if driver in DRIVERS:
        return tuple(DRIVERS[driver])
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
        return able[0] if len(able) == 1 or driver in DRIVERS else None
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
