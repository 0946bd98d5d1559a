"""Make a device by its driver's name, only when a scene asks for it."""

import importlib
import inspect
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from mmt.core.errors import InputError, MmtError
from mmt.devices.table import Role, locate
from mmt.scene.files import explain_problems

Options = TypeVar("Options", bound=BaseModel)


def load_device(
    driver: str, options: Mapping[str, Any] | None = None, *, role: Role | None = None
) -> Any:
    """Import the driver's module and call its factory with the options.

    Parameters
    ----------
    driver, role
        See `mmt.devices.table.locate`.
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
        module = importlib.import_module(module_name)
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
