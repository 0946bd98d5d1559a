"""A model's kernel parameters: what compiled code needs beside an interpolant to give filters.

One array: a few numbers at the places below, then a table of the level where there is one
(`mmt.texture.field.level_table`).
"""

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.texture.autoregression.lsf import lsf_inverse_gain
from mmt.texture.field.level_table import TABLE_SIZES, tabulated_level
from mmt.texture.interpolation.interpolant import SCRATCH, interpolate_into

PER_SPEED, PER_FORCE, DIMENSIONS, MODEL_ORDER = range(4)
"""Places in `TextureModel.kernel_parameters`: one array costs a compiled call less than four
numbers. A table of the level follows, see `mmt.texture.field.level_table`."""


@kernel("void(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[::1])")
def filters_into(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    parameters: FloatArray,
    points: FloatArray,
    lsf: FloatArray,
    variance: FloatArray,
) -> None:
    """Write LSF (k, m) and excitation variances (k,) at points (k, d).

    `rows`, `links` and `tail` are the interpolant's, whose level is the variance where there is no
    table of powers. The gain of a mean of LSF is no mean of gains.
    """
    hint, work, values = 0, np.empty(SCRATCH), np.empty(1 + lsf.shape[1])
    for row in range(len(points)):
        hint = interpolate_into(rows, links, tail, hint, points[row], values, work)
        for k in range(lsf.shape[1]):
            lsf[row, k] = values[1 + k]
        variance[row] = values[0]
        if parameters[TABLE_SIZES] > 0.0:
            y = points[row, 1] if points.shape[1] == 3 else 0.0
            force = points[row, points.shape[1] - 1]
            power = tabulated_level(parameters, points[row, 0], y, force)
            variance[row] = power * lsf_inverse_gain(lsf[row], work) if power > 0.0 else 0.0
