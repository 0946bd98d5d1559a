"""The families of cases, each in a module of its own that is loaded when it is asked for."""

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mmt.core.errors import InputError
from mmt_lab.harness.cases import Case


@dataclass(frozen=True)
class Family:
    """Where a family's cases are, and what they are about."""

    module: str
    title: str


FAMILIES: Final[dict[str, Family]] = {
    "ar": Family("autoregression", "Fits of difficult signals, against 120 digits"),
    "lsf": Family("lines", "Line spectral frequencies and rendering"),
    "model": Family("models", "Texture models of any samples"),
    "anisotropic": Family("anisotropic", "Models of velocity and force"),
    "networks": Family("networks", "Radial basis networks"),
    "contact": Family("contact", "Stiff contact"),
    "loop": Family("closed_loop", "Force feedback over a delay"),
    "services": Family("services", "Clocks, bursts and uptime"),
}
"""A further family is a module with a function ``cases`` and a line here."""


def load_cases(names: Sequence[str]) -> dict[str, list[Case]]:
    """Return the cases of the named families, of all where none is named.

    Raises
    ------
    InputError
        A name is none of the families.
    """
    unknown = [name for name in names if name not in FAMILIES]
    if unknown:
        raise InputError(f"stability {unknown[0]}: allowed are {', '.join(FAMILIES)}")
    chosen = [name for name in FAMILIES if name in names or not names]
    return {name: _module_cases(FAMILIES[name].module) for name in chosen}


def _module_cases(module: str) -> list[Case]:
    found: list[Case] = importlib.import_module(f"mmt_lab.stability.{module}").cases()
    return found
