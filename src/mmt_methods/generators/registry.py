"""Find builders of generators by name; a builder is imported only when it is loaded."""

import inspect
from contextlib import suppress
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Final, cast

from mmt.core.errors import InputError, short_message
from mmt.core.plugins import load as load_entry
from mmt.core.plugins import offered

if TYPE_CHECKING:
    from mmt_methods.generators.protocol import Builder

GROUP: Final = "mmt.generators"
"""The group of entry points under which a package offers builders of generators by name."""


def load(name: str) -> "Builder":
    """Import a builder.

    Parameters
    ----------
    name
        A name that an installed package offers, or ``package.module:builder``.

    Raises
    ------
    InputError
        There is no builder of that name, it cannot be imported, or it is no builder.
    """
    entry = _find(name)
    builder = load_entry(entry, f"generator {name!r}")
    try:
        with suppress(ValueError):  # a builder in C may have no signature
            inspect.signature(builder).bind(None, None)
    except TypeError as error:
        raise InputError(
            f"generator {name!r}: {entry.value} is no builder, which is called as "
            f"build(observed, previous) ({short_message(error)})"
        ) from error
    return cast("Builder", builder)


def origin(name: str) -> str:
    """Return where a builder comes from: its target, and the distribution that offers it.

    Raises
    ------
    InputError
        There is no builder of that name.
    """
    entry = _find(name)
    of = "" if entry.dist is None else f" of {entry.dist.name} {entry.dist.version}"
    return f"{entry.value}{of}"


def _find(name: str) -> EntryPoint:
    if ":" in name:
        return EntryPoint(name, name, GROUP)
    builders = offered(GROUP)
    if name not in builders:
        raise InputError(
            f"generator {name!r} is not known; allowed are {', '.join([*sorted(builders), ''])}"
            "package.module:builder, and the names that installed packages offer as entry points "
            f"of {GROUP}"
        )
    return builders[name]
