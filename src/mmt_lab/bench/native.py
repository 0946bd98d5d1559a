"""C loops beside the compiled kernels, where a C compiler is there.

They are no part of the product: a run of the bench compiles ``loops.c`` into a temporary
folder to say how much numba's strict floating point costs.
"""

import ctypes
import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.texture.model.texture_model import TextureModel
from mmt_lab.harness.findings import LeftOut

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
        """Render speed and force (n,) from standard normal noise (n,), power interpolated."""
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
def compiled() -> Iterator[Loops | LeftOut]:
    """Compile the loops for as long as the context lasts, or say why they cannot be."""
    names = [os.environ["CC"]] if os.environ.get("CC") else _COMPILERS
    compiler = next((found for name in names if (found := shutil.which(name))), None)
    if compiler is None:
        yield LeftOut("C loops", "no C compiler is there", "install one, such as gcc")
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
            yield LeftOut("C loops", f"{compiler} failed: {reason}", "look at the compiler")
            return
        yield loops


def _doubles(array: FloatArray) -> Any:
    return array.ctypes.data_as(_DOUBLES)


def _longs(array: IntArray) -> Any:
    return array.ctypes.data_as(_LONGS)
