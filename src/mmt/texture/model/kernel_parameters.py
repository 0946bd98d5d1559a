"""A model's law: what compiled code needs to read filters from an interpolant.

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
from mmt.texture.interpolation.interpolant import DELAUNAY
from mmt.texture.interpolation.interpolators import LARGEST_SCRATCH, evaluate_into, planar_into
from mmt.texture.settings import Interpolated

LEVELS: Final[dict[Interpolated, int]] = {"variance": 0, "power": 1, "amplitude": 2}
"""What is interpolated linearly, by its number in the compiled kernels."""

KIND, LEVEL_KIND, SPEED_EXPONENT, FORCE_EXPONENT, PER_SPEED, PER_FORCE = range(6)
DIMENSIONS, MODEL_ORDER = 6, 7
"""Places in `TextureModel.law`: one array costs a compiled call less than eight numbers. A table of
the level follows, see `mmt.texture.field.level_table`."""


@kernel("void(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[::1])")
def filters_into(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    law: FloatArray,
    points: FloatArray,
    lsf: FloatArray,
    variance: FloatArray,
) -> None:
    """Write LSF (k, m) and excitation variances (k,) at points.

    The gain of a mean of LSF is no mean of gains.
    """
    kind, level_kind, place = int(law[KIND]), int(law[LEVEL_KIND]), 0
    work, values = np.empty(LARGEST_SCRATCH), np.empty(1 + lsf.shape[1])
    planar = kind == DELAUNAY and points.shape[1] == 2
    for row in range(len(points)):
        if planar:
            x, y = points[row, 0], points[row, 1]
            place = planar_into(rows, links, place, x, y, values, work)
        else:
            place = evaluate_into(kind, rows, links, tail, place, points[row], values, work)
        for k in range(lsf.shape[1]):
            lsf[row, k] = values[1 + k]
        level = values[0]
        if law[TABLE_SIZES] > 0.0:
            y = points[row, 1] if points.shape[1] == 3 else 0.0
            level = tabulated_level(law, points[row, 0], y, points[row, points.shape[1] - 1])
        elif law[SPEED_EXPONENT] > 0.0:
            level *= trend_at(law[SPEED_EXPONENT], law[FORCE_EXPONENT], points[row])
        if level_kind != 0 and level != 0.0:
            if level_kind == 2:
                level *= level
            level *= lsf_inverse_gain(lsf[row], work)
        variance[row] = level
