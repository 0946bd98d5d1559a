"""Find a device by its name, ``package.module:factory``, only when a scene asks for it."""

import importlib
from typing import Any

from mmt.errors import InputError, MmtError


def load_device(name: str) -> Any:
    """Import the module and call the factory without arguments.

    Raises
    ------
    InputError
        The module cannot be imported, or has no such factory.
    MmtError
        The device cannot be made.
    """
    module_name, _, factory_name = name.partition(":")
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # a driver may want a library, a file, a version of Python
        raise InputError(
            f"device {name!r}: module {module_name} cannot be imported ({error}); "
            "install the package that holds it, and what it needs"
        ) from error
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise InputError(f"device {name!r}: module {module_name} has no factory {factory_name!r}")
    try:
        return factory()
    except MmtError:
        raise
    except Exception as error:
        raise MmtError(
            f"device {name!r} cannot be made: {str(error) or type(error).__name__}"
        ) from error
