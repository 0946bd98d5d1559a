"""Other packages that do the same work, where they are installed."""

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

_MODULES: Final = {
    "librosa": "librosa",
    "memspectrum": "memspectrum",
    "mpmath": "mpmath",
    "pysptk": "pysptk",
    "spectrum": "spectrum",
    "statsmodels": "statsmodels.regression.linear_model",
}
"""What is imported of each package, by the name under which it is installed."""


FAILURES: Final = (
    ArithmeticError,
    AssertionError,
    InputError,
    LookupError,
    NameError,  # spectrum, where it means to report a filter that is not stable
    RuntimeError,
    ValueError,
)
"""What a method may raise where it fails."""


@contextmanager
def quiet() -> Iterator[None]:
    """Show no warnings: what peers warn of, such as an unstable result, is in the tables."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def find(names: Sequence[str]) -> tuple[dict[str, ModuleType], tuple[SkippedMethod, ...]]:
    """Return the modules of the packages that are here, and those that are not."""
    modules: dict[str, ModuleType] = {}
    left_out = []
    for name in names:
        try:
            with quiet():
                modules[name] = importlib.import_module(_MODULES[name])
        except ImportError as error:
            remedy = f"pip install {name}, or {install_command('bench')}"
            left_out.append(SkippedMethod(name, f"cannot be imported: {error}", remedy))
    return modules, tuple(left_out)
