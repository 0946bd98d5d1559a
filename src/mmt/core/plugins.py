"""Find and load plug-ins: entry points of installed packages, the product's own included.

The groups are ``mmt.commands``, ``mmt.devices``, ``mmt.emulators``, ``mmt.files``, ``mmt.parts``
and ``mmt.generators``.
"""

import sys
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import Distribution, EntryPoint, entry_points
from typing import Any

from mmt.core.errors import InputError, located, short_message
from mmt.core.extras import DISTRIBUTION, optional_import


def offered(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name.

    If another package uses a name of the product, the product's entry point is returned.
    """
    return _installed(group, tuple(sys.path))


def is_own(entry: EntryPoint) -> bool:
    """Return whether an entry point is the product's own."""
    return package_of(entry) == DISTRIBUTION


def package_of(entry: EntryPoint) -> str:
    """Return the name of the package that offers an entry point, "?" if it is not known."""
    return "?" if entry.dist is None else _name(entry.dist)


def load(entry: EntryPoint, what: str) -> Any:
    """Import the object that an entry point names.

    Raises
    ------
    InputError
        The object cannot be imported; the message begins with `what`.
    """
    try:
        with optional_import():
            return entry.load()
    except InputError:
        raise
    except Exception as error:  # a library, a file or a Python version may be missing
        raise not_imported(f"{what}: {entry.value}", error) from error


def not_imported(what: str, error: Exception) -> InputError:
    """Return the error that says why `what` cannot be imported, and what to do."""
    reason = short_message(error) if isinstance(error, ModuleNotFoundError) else located(error)
    if not isinstance(error, ImportError | OSError):
        return InputError(f"{what} cannot be imported ({reason})")
    return InputError(
        f"{what} cannot be imported ({reason}); install the package that holds it, and what it "
        "needs (pip install -e DIRECTORY), or name the directory in PYTHONPATH"
    )


@lru_cache(maxsize=16)
def _installed(group: str, _path: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    """Read the entry points of a group, which takes some milliseconds."""
    return {entry.name: entry for entry in sorted(entry_points(group=group), key=is_own)}


@lru_cache(maxsize=64)
def _name(distribution: Distribution) -> str:
    """Return the name of a package; each reading takes some milliseconds."""
    return distribution.name
