"""Burg's method as this package and others have it, each as its own documentation calls it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg import burg, burg_batch
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt_lab.bench import peers
from mmt_lab.harness.findings import LeftOut

OURS: Final = "mmt"

Fit = Callable[[FloatArray, int], FloatArray]
"""From a segment (n,) and an order to filter coefficients (order,)."""


@dataclass(frozen=True)
class Method:
    """One implementation: what is timed for one segment and for a batch, and its result.

    ``fit_batch`` is None where the package has no call for a batch: its time is that of its
    calls one after the other.
    """

    name: str
    fit: Callable[[FloatArray, int], object]
    coefficients: Fit
    fit_batch: Callable[[FloatArray, int], object] | None = None


def find() -> tuple[list[Method], tuple[LeftOut, ...]]:
    """Return ours and those of the packages that are installed, and which are not."""
    modules, left_out = peers.find(("librosa", "memspectrum", "spectrum", "statsmodels"))
    return [_ours(), *_peers(modules)], left_out


def _ours() -> Method:
    return Method(
        OURS, burg, lambda x, order: reflection_to_ar(burg(x, order).reflection), burg_batch
    )


def _peers(modules: Mapping[str, ModuleType]) -> list[Method]:
    """Return the peers that are here, each as its own documentation has it called."""
    makers: dict[str, Callable[[Any], list[Method]]] = {
        "librosa": _librosa,
        "spectrum": lambda module: [
            _single("spectrum", lambda x, order: module.arburg(x, order)[0].real)
        ],
        "statsmodels": lambda module: [
            _single("statsmodels", lambda x, order: -module.burg(x, order, demean=False)[0])
        ],
        "memspectrum": lambda module: [
            _single(f"memspectrum, {kind}", _memspectrum(module, kind))
            for kind in ("standard", "Fast")
        ],
    }
    return [method for name, module in modules.items() for method in makers[name](module)]


def _single(name: str, fit: Fit) -> Method:
    return Method(name, fit, fit)


def _librosa(module: Any) -> list[Method]:
    def fit(x: FloatArray, order: int) -> FloatArray:
        return np.asarray(module.lpc(x, order=order)[1:], dtype=np.float64)

    return [Method("librosa", fit, fit, lambda rows, order: module.lpc(rows, order=order))]


def _memspectrum(module: Any, kind: str) -> Fit:
    def fit(x: FloatArray, order: int) -> FloatArray:
        solver = module.MESA()
        solver.solve(x, m=order + 1, optimisation_method="Fixed", method=kind)
        return np.asarray(solver.a_k[1:], dtype=np.float64)

    return fit
