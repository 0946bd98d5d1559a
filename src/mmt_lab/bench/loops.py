"""Compiled kernels beside the same loops in C."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.burg_recursion import burg_each_into
from mmt.texture.autoregression.lsf import lsf_to_ar_each_into
from mmt_lab.bench import native, signals
from mmt_lab.bench.measuring import interleave
from mmt_lab.harness.findings import MICROSECONDS, Cell, LeftOut, Records

Compared = tuple[tuple[Records, ...], tuple[LeftOut, ...]]
"""A table, or why there is none."""

_NUMBA, _C = "numba", "C"


def burg_loops(batches: Sequence[tuple[int, int]], orders: Sequence[int], rounds: int) -> Compared:
    """Time Burg's method on batches, given as segments and their samples, without any check."""
    with native.compiled() as loops:
        if not isinstance(loops, native.Loops):
            return (), (loops,)
        rows = []
        for count, length in batches:
            x = np.concatenate([signals.texture(length, seed=seed) for seed in range(count)])
            stops = np.arange(1, count + 1, dtype=np.int64) * length
            for order in orders:
                reflection, variances = np.empty((2, count, order)), np.empty((2, count, order + 1))
                row = _compare(
                    partial(burg_each_into, x, stops, reflection[0], variances[0]),
                    loops.burg_call(x, stops, reflection[1], variances[1]),
                    count,
                    rounds,
                )
                rows.append({"segments": count, "samples": length, "order": order, **row})
    return (_table("Burg's method", "segment", rows),), ()


def lines_loops(filters: Mapping[int, FloatArray], rounds: int) -> Compared:
    """Time the way back from line spectral frequencies (n, m), given by order."""
    with native.compiled() as loops:
        if not isinstance(loops, native.Loops):
            return (), (loops,)
        rows = []
        for order, lsf in filters.items():
            row = _compare(
                partial(lsf_to_ar_each_into, lsf, np.empty_like(lsf)),
                loops.lsf_to_ar_call(lsf, np.empty_like(lsf)),
                len(lsf),
                rounds,
            )
            rows.append({"order": order, **row})
    return (_table("Back to coefficients", "filter", rows),), ()


def _compare(
    ours: Callable[[], object], theirs: Callable[[], object], count: int, rounds: int
) -> dict[str, Cell]:
    times = interleave({_NUMBA: ours, _C: theirs}, rounds)
    one = {name: time.median * MICROSECONDS / count for name, time in times.items()}
    return {
        "numba (µs)": one[_NUMBA],
        "C (µs)": one[_C],
        "numba over C": one[_NUMBA] / one[_C],
    }


def _table(what: str, unit: str, rows: Sequence[Mapping[str, Cell]]) -> Records:
    title = f"{what}: the same loop in C (-O3, this processor), time of one {unit}"
    return Records("loops", title, tuple(rows))
