"""Prior of a surface's spectrum: what is expected of any surface before it was touched.

Each component of the spectrum (`mmt.texture.surfaces.bands`) is the process of
`mmt.texture.field.covariance`, with its hyperparameters, of a size of its own. The figures below
are the spread among the development half of HaTT's models, component by component, rounded up: on
average over speeds and forces (constant), and within a model about that (size, over the level's).
"""

from typing import Final

import numpy as np

MEANS: Final = np.array([-2.6, 1.7, -0.3, 0.15, 0.0, 0.0])
"""Prior means of the components, nepers of power in (m/s2)^2."""

CONSTANTS: Final = np.array([3.0, 0.7, 0.5, 0.25, 0.2, 0.15])
"""Standard deviations of their constants."""

SIZES: Final = np.array([1.0, 0.5, 0.3, 0.2, 0.15, 0.12])
"""Sizes of their slopes and departures over those of the level."""

NUGGET: Final = np.array([0.05, 0.05, 0.045, 0.04, 0.032, 0.025])
"""Variance of the components of a block of white noise, nepers^2 (measured)."""

SILL: Final = 0.002
"""Least variance between places, nepers^2."""

NU: Final = 8.0
"""Degrees of freedom of the scatter's tails: a single block never tells much."""
