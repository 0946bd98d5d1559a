"""Peers: other packages that do the same work, as far as they are installed."""

import importlib
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.extras import install_command
from mmt_lab.harness.findings import SkippedMethod

_MODULES: Final = {"statsmodels": "statsmodels.regression.linear_model"}
"""Module that is imported of a package, if it has another name than the package."""


FAILURES: Final = (
    ArithmeticError,
    AssertionError,
    InputError,
    LookupError,
    NameError,  # from spectrum, when it tries to report an unstable filter
    RuntimeError,
    ValueError,
)
"""Exceptions that a method may raise when it fails."""


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress warnings: the tables show what peers warn of, such as an unstable result."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def find(names: Sequence[str]) -> tuple[dict[str, ModuleType], tuple[SkippedMethod, ...]]:
    """Return the modules of the installed packages, and the packages that are missing."""
    modules: dict[str, ModuleType] = {}
    left_out = []
    for name in names:
        try:
            with quiet():
                modules[name] = importlib.import_module(_MODULES.get(name, name))
        except ImportError as error:
            remedy = f"pip install {name}, or {install_command('bench')}"
            left_out.append(SkippedMethod(name, f"cannot be imported: {error}", remedy))
    return modules, tuple(left_out)
