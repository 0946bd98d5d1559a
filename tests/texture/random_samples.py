"""Points, strokes and samples of models drawn at random, for tests of what is made of them."""

import numpy as np

from mmt.texture.autoregression.forms import output_power, reflection_to_lsf
from mmt.texture.space import ISOTROPIC, TextureSamples


def scattered(count, directed=False, seed=0):
    """Return normalised points (count, d) inside the space."""
    random = np.random.default_rng(seed)
    speed, force = random.uniform(0.07, 0.95, count), random.uniform(0.07, 0.95, count)
    if not directed:
        return np.column_stack([speed, force])
    heading = random.uniform(-np.pi, np.pi, count)
    return np.column_stack([speed * np.cos(heading), speed * np.sin(heading), force])


def speed_of(points):
    """Return the speeds (count,) of points of either space."""
    return np.linalg.norm(points[:, :-1], axis=1)


def strokes_in(space, count, seed=0):
    """Return inputs (count, d) inside the space, none of them at rest."""
    random = np.random.default_rng(seed)
    speed, heading = random.uniform(20, 290, count), random.uniform(-np.pi, np.pi, count)
    force = random.uniform(0.2, 2.9, count)
    return space.from_motion(speed * np.cos(heading), speed * np.sin(heading), force)


def fitted(inputs, space=ISOTROPIC, *, order=8):
    """Return samples with filters of their own at inputs (n, d)."""
    random = np.random.default_rng(order)
    reflection = random.uniform(-0.8, 0.8, (len(inputs), order))
    variance = random.uniform(0.5, 2.0, len(inputs))
    power = output_power(variance, reflection)
    places = np.asarray(inputs, dtype=float)
    return TextureSamples(places, reflection_to_lsf(reflection), variance, power, space)
