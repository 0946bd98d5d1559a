"""Families of the cases of ``mmt stability``: a module each, with a `FAMILY`."""

import importlib
import pkgutil
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from mmt_lab.stability.cases import Family


def family_names() -> list[str]:
    """Return the names of all families, in alphabetical order, without importing them."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__))


Families = Annotated[
    list[str] | None,
    typer.Argument(metavar="FAMILY", help=f"{', '.join(family_names())}; all if none is named."),
]
"""The families that are named on the command line."""


def load_family(name: str) -> "Family":
    """Import a family by its name."""
    found: Family = importlib.import_module(f"{__name__}.{name}").FAMILY
    return found
