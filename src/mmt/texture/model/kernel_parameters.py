"""A model's kernel parameters: what compiled code needs beside an interpolant to give filters.

One array: a few numbers at the places below, then a table of the level where there is one
(`mmt.texture.field.level_table`).
"""

from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.lsf import lsf_inverse_gain
from mmt.texture.field.level_table import TABLE_SIZES, tabulated_level
from mmt.texture.field.trend import trend_at
from mmt.texture.interpolation.interpolator import SCRATCH, evaluate_into
from mmt.texture.settings import Interpolated

LEVELS: Final[dict[Interpolated, int]] = {"variance": 0, "power": 1, "amplitude": 2}
"""What is interpolated linearly, by its number in the compiled kernels."""

LEVEL_KIND, SPEED_EXPONENT, FORCE_EXPONENT, PER_SPEED, PER_FORCE, DIMENSIONS, MODEL_ORDER = range(7)
"""Places in `TextureModel.kernel_parameters`: one array costs a compiled call less than seven
numbers. A table of the level follows, see `mmt.texture.field.level_table`."""


@kernel("void(i8, f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[::1])")
def filters_into(
    evaluator: int,
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    parameters: FloatArray,
    points: FloatArray,
    lsf: FloatArray,
    variance: FloatArray,
) -> None:
    """Write LSF (k, m) and excitation variances (k,) at points (k, d).

    `evaluator` is the address of the interpolant's evaluator, whose arrays follow. The gain of a
    mean of LSF is no mean of gains.
    """
    level_kind, hint = int(parameters[LEVEL_KIND]), 0
    work, values = np.empty(SCRATCH), np.empty(1 + lsf.shape[1])
    for row in range(len(points)):
        hint = evaluate_into(evaluator, rows, links, tail, hint, points[row], values, work)
        for k in range(lsf.shape[1]):
            lsf[row, k] = values[1 + k]
        level = values[0]
        if parameters[TABLE_SIZES] > 0.0:
            y = points[row, 1] if points.shape[1] == 3 else 0.0
            force = points[row, points.shape[1] - 1]
            level = tabulated_level(parameters, points[row, 0], y, force)
        elif parameters[SPEED_EXPONENT] > 0.0:
            level *= trend_at(parameters[SPEED_EXPONENT], parameters[FORCE_EXPONENT], points[row])
        if level_kind != 0 and level != 0.0:
            if level_kind == 2:
                level *= level
            level *= lsf_inverse_gain(lsf[row], work)
        variance[row] = level
