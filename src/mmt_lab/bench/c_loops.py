"""The same loops in C beside the compiled kernels, where there is a C compiler.

A run of the bench compiles ``loops.c`` into a temporary folder, to measure what numba's strict
floating point costs.
"""

import ctypes
import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.autoregression.burg_recursion import burg_each_into
from mmt.texture.autoregression.lsf import lsf_to_ar_each_into
from mmt.texture.model.texture_model import TextureModel
from mmt_lab.bench.measuring import interleave
from mmt_lab.harness.findings import MICROSECONDS, Cell, FindingsTable, SkippedMethod

_SOURCE: Final = Path(__file__).with_name("loops.c")
_FLAGS: Final = ("-O3", "-march=native", "-std=c99", "-shared", "-fPIC")
_COMPILERS: Final = ("cc", "gcc", "clang")
_PATIENCE_S: Final = 60.0

_DOUBLES: Final = ctypes.POINTER(ctypes.c_double)
_LONGS: Final = ctypes.POINTER(ctypes.c_int64)


class Loops:
    """The compiled library; every method returns a call without arguments, to be timed."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._burg = library.burg_each
        self._burg.restype = None
        self._lsf_to_ar = library.lsf_to_ar_each
        self._lsf_to_ar.restype = None
        self._render = library.render
        self._render.restype = ctypes.c_int64

    def burg_call(
        self, joined: FloatArray, stops: IntArray, reflection: FloatArray, variances: FloatArray
    ) -> Callable[[], None]:
        """Fit what `mmt.texture.autoregression.burg_recursion.burg_each_into` does."""
        work = np.empty(2 * int(np.diff(stops, prepend=0).max()))
        counts = ctypes.c_int64(len(stops)), ctypes.c_int64(reflection.shape[1])
        return self._call(
            self._burg, _doubles(joined), _longs(stops), *counts,
            _doubles(reflection), _doubles(variances), _doubles(work),
        )  # fmt: skip

    def lsf_to_ar_call(self, lsf: FloatArray, ar: FloatArray) -> Callable[[], None]:
        """Convert line spectral frequencies (n, m) into filter coefficients (n, m)."""
        counts = ctypes.c_int64(lsf.shape[0]), ctypes.c_int64(lsf.shape[1])
        return self._call(self._lsf_to_ar, _doubles(lsf), *counts, _doubles(ar))

    def render_call(
        self,
        model: TextureModel,
        motion: tuple[FloatArray, FloatArray],
        renewal: int,
        noise: FloatArray,
        output: FloatArray,
    ) -> Callable[[], None]:
        """Render speed and force (n,) from standard normal noise (n,), by a published model."""
        vertices, memory = np.array(model.vertices), np.zeros(model.order)
        return self._call(
            self._render,
            _doubles(vertices),
            ctypes.c_int64(vertices.shape[1]),
            _longs(model.triangles),
            ctypes.c_int64(len(model.triangles)),
            _doubles(motion[0]),
            _doubles(motion[1]),
            ctypes.c_double(1.0 / model.space.maximum_speed_mm_s),
            ctypes.c_double(1.0 / model.space.maximum_force_n),
            ctypes.c_int64(renewal),
            ctypes.c_double(60.0),
            ctypes.c_double(math.exp(-1.0 / (0.004 * model.rate_hz))),
            _doubles(noise),
            ctypes.c_int64(len(output)),
            _doubles(memory),
            _doubles(output),
        )

    @staticmethod
    def _call(function: Any, *arguments: Any) -> Callable[[], None]:
        """Bind the arguments; the arrays live as long as the call does."""
        return lambda: function(*arguments)


@contextmanager
def compiled() -> Iterator[Loops | SkippedMethod]:
    """Compile the loops for a `with` block; yield them, or why they cannot be compiled."""
    names = [os.environ["CC"]] if os.environ.get("CC") else _COMPILERS
    compiler = next((found for name in names if (found := shutil.which(name))), None)
    if compiler is None:
        yield SkippedMethod("C loops", "there is no C compiler", "install one, such as gcc")
        return
    with tempfile.TemporaryDirectory() as directory:
        library = Path(directory) / "loops.so"
        command = [compiler, *_FLAGS, str(_SOURCE), "-o", str(library), "-lm"]
        try:
            subprocess.run(  # noqa: S603 - our own source, by the compiler of this machine
                command, check=True, capture_output=True, text=True, timeout=_PATIENCE_S
            )
            loops = Loops(ctypes.CDLL(str(library)))
        except (OSError, subprocess.SubprocessError, AttributeError) as error:
            reason = getattr(error, "stderr", None) or str(error)
            yield SkippedMethod("C loops", f"{compiler} failed: {reason}", "look at the compiler")
            return
        yield loops


def _doubles(array: FloatArray) -> Any:
    return array.ctypes.data_as(_DOUBLES)


def _longs(array: IntArray) -> Any:
    return array.ctypes.data_as(_LONGS)


_NUMBA, _C = "numba", "C"

Compared = tuple[tuple[FindingsTable, ...], tuple[SkippedMethod, ...]]
"""A table, or why there is none."""


def burg_loops(batches: Sequence[tuple[int, int]], orders: Sequence[int], rounds: int) -> Compared:
    """Time Burg's method on batches, given as segments and their samples, without any check."""
    from mmt_lab.bench import signals  # needs mpmath, which other users of this module do not

    with compiled() as loops:
        if not isinstance(loops, Loops):
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
    with compiled() as loops:
        if not isinstance(loops, Loops):
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


def _table(what: str, unit: str, rows: Sequence[Mapping[str, Cell]]) -> FindingsTable:
    title = f"{what}: the same loop in C (-O3, this processor), time of one {unit}"
    return FindingsTable("loops", title, tuple(rows))
