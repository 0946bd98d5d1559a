"""Find a device by its name, ``package.module:factory``, only when a scene asks for it."""

import importlib
from typing import Any

from mmt.errors import InputError


def load_device(name: str) -> Any:
    """Import the module and call the factory without arguments.

    Raises
    ------
    InputError
        The module cannot be imported, or has no such factory.
    """
    module_name, _, factory_name = name.partition(":")
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise InputError(
            f"device {name!r}: module {module_name} cannot be imported ({error}); "
            "install the package that holds it"
        ) from error
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise InputError(f"device {name!r}: module {module_name} has no factory {factory_name!r}")
    return factory()
