"""Builders of generators by name; none is imported before it is asked for."""

import importlib
import inspect
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Final, cast

from mmt.core.errors import InputError, brief

if TYPE_CHECKING:
    from mmt.texture.generators.protocol import Builder

GROUP: Final = "mmt.generators"
"""The group of entry points under which a package offers builders of generators by name."""


def offered() -> dict[str, EntryPoint]:
    """Return the builders that installed packages offer, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def load(name: str) -> "Builder":
    """Import a builder.

    Parameters
    ----------
    name
        A name that an installed package offers, or ``package.module:builder``.

    Raises
    ------
    InputError
        There is none of that name, it cannot be imported, or it is no builder.
    """
    module_name, _, attribute = _target(name).partition(":")
    try:
        found = importlib.import_module(module_name)
    except Exception as error:  # it may want a library, a file, a version of Python
        raise InputError(
            f"generator {name!r}: module {module_name} cannot be imported ({brief(error)}); "
            "install the package that holds it, and what it needs (pip install -e DIRECTORY), or "
            "name the directory in PYTHONPATH"
        ) from error
    builder = getattr(found, attribute, None)
    if not callable(builder):
        raise InputError(f"generator {name!r}: module {module_name} has no function {attribute!r}")
    try:
        inspect.signature(builder).bind(None, None)
    except TypeError as error:
        raise InputError(
            f"generator {name!r}: {attribute}{inspect.signature(builder)} is no builder, which is "
            "called as build(observed, previous)"
        ) from error
    except ValueError:  # one in C may have no signature
        pass
    return cast("Builder", builder)


def origin(name: str) -> str:
    """Return where a builder comes from: its target, and the distribution that offers it.

    Raises
    ------
    InputError
        There is none of that name.
    """
    found = offered().get(name)
    if found is None or found.dist is None:
        return _target(name)
    return f"{found.value} of {found.dist.name} {found.dist.version}"


def _target(name: str) -> str:
    if ":" in name:
        return name
    others = offered()
    if name in others:
        return others[name].value
    raise InputError(
        f"generator {name!r} is not known; allowed are {', '.join([*sorted(others), ''])}"
        "package.module:builder, and the names that installed packages offer as entry points of "
        f"{GROUP}"
    )
