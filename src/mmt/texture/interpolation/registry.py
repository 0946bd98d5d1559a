"""Interpolators by name; none is imported before a model asks for it.

How to add one is in ``docs/how-to/add-an-interpolator.md``.
"""

import importlib
from typing import TYPE_CHECKING, Final, cast

from mmt.core.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from mmt.texture.interpolation.interpolator import Builder

GROUP: Final = "mmt.interpolators"
"""The group of entry points under which another package offers interpolators by name."""

INTERPOLATORS: Final[dict[str, str]] = {
    "delaunay": "mmt.texture.interpolation.delaunay:build",
    "nearest": "mmt.texture.interpolation.nearest:build",
    "rbf": "mmt.texture.interpolation.radial_basis.interpolator:build",
    "network": "mmt.texture.interpolation.radial_basis.interpolator:build_published",
}
"""Name -> ``module:builder`` of the interpolators that are known without an entry point."""

WITHOUT_TREND: Final = frozenset({"network"})
"""Those of the level itself; others have an anisotropic level over a power law."""


def offered() -> "dict[str, EntryPoint]":
    """Return the interpolators that other installed packages offer, by name."""
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in entry_points(group=GROUP)}


def check_name(name: str) -> None:
    """Raise `ValueError` where no interpolator has a name; the message lists those there are."""
    if name not in INTERPOLATORS and name not in offered():
        raise ValueError(_unknown(name))


def load(name: str) -> "Builder":
    """Import an interpolator, which compiles its kernel; return its builder.

    Raises
    ------
    InputError
        There is none of that name; the message lists those there are.
    """
    if name in INTERPOLATORS:
        module, _, builder = INTERPOLATORS[name].partition(":")
        return cast("Builder", getattr(importlib.import_module(module), builder))
    others = offered()
    if name not in others:
        raise InputError(_unknown(name))
    return cast("Builder", others[name].load())


def _unknown(name: str) -> str:
    names = ", ".join(sorted({*INTERPOLATORS, *offered()}))
    return (
        f"interpolator is {name!r}, allowed are {names}, and names that other packages offer as "
        f"entry points of {GROUP}"
    )
