"""A smooth texture of known truth, sampled, fitted and knocked on."""

import numpy as np
from scipy.signal import lfilter

from mmt.texture.autoregression.forms import lsf_to_ar
from mmt_methods.selection import ModelPoints

ORDER = 8


def true_lsf(points):
    """Line spectral frequencies that glide with the place, shape (n, ORDER)."""
    even = np.pi * (np.arange(ORDER) + 1.0) / (ORDER + 1.0)
    pull = 0.09 * np.cos(np.pi * np.arange(ORDER)) * (0.6 + 0.4 * points[:, :1])
    return even + pull + 0.05 * (points[:, 1:2] - 0.5)


def sampled_texture(n, dimensions, knocks, seed=0):
    """Return points with their segments, and which of them hold a knock (0.4 of the variance)."""
    generator = np.random.default_rng(seed)
    points = generator.random((n, dimensions))
    filters = np.insert(lsf_to_ar(true_lsf(points)), 0, 1.0, axis=1)
    level = 0.1 + points[:, 0] * (0.5 + points[:, 1])
    knocked = np.zeros(n, dtype=np.bool_)
    knocked[generator.choice(n, knocks, replace=False)] = True
    segments = []
    for index in range(n):
        noise = np.sqrt(level[index]) * generator.standard_normal(460)
        segment = lfilter([1.0], filters[index], noise)[200:]
        if knocked[index]:
            knock = np.zeros(260)
            time_s = np.arange(160) / 1000.0
            knock[100:] = np.exp(-time_s / 0.015) * np.sin(2 * np.pi * 150.0 * time_s)
            segment = segment + knock * segment.std() / knock.std() * np.sqrt(0.4)
        segments.append(segment)
    return ModelPoints.fitted(points, segments, ORDER, 1000.0), knocked
