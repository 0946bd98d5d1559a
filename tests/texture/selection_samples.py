"""A smooth texture of known truth, sampled, fitted and knocked on."""

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.texture.autoregression.burg import burg_batch
from mmt.texture.autoregression.forms import lsf_to_reflection, reflection_to_lsf
from mmt.texture.autoregression.simulation import simulate_ar
from mmt.texture.selection import ModelPoints

ORDER = 8


def true_lsf(points: FloatArray) -> FloatArray:
    """Line spectral frequencies that glide with the place, shape (n, ORDER)."""
    even = np.pi * (np.arange(ORDER) + 1.0) / (ORDER + 1.0)
    pull = 0.09 * np.cos(np.pi * np.arange(ORDER)) * (0.6 + 0.4 * points[:, :1])
    return even + pull + 0.05 * (points[:, 1:2] - 0.5)


def sampled_texture(
    n: int, dimensions: int, knocks: int, seed: int = 0
) -> tuple[ModelPoints, BoolArray]:
    """Return points with their segments, and which of them hold a knock (0.4 of the variance)."""
    generator = np.random.default_rng(seed)
    points = generator.random((n, dimensions))
    reflection = lsf_to_reflection(true_lsf(points))
    level = 0.1 + points[:, 0] * (0.5 + points[:, 1])
    knocked = np.zeros(n, dtype=np.bool_)
    knocked[generator.choice(n, knocks, replace=False)] = True
    segments = []
    for index in range(n):
        segment = simulate_ar(reflection[index], level[index], 260, generator)
        if knocked[index]:
            knock = np.zeros(260)
            time_s = np.arange(160) / 1000.0
            knock[100:] = np.exp(-time_s / 0.015) * np.sin(2 * np.pi * 150.0 * time_s)
            segment = segment + knock * segment.std() / knock.std() * np.sqrt(0.4)
        segments.append(segment)
    fits = burg_batch(segments, ORDER)
    lsf = reflection_to_lsf(fits.reflection)
    return ModelPoints(points, lsf, fits.variances[:, -1], segments), knocked
