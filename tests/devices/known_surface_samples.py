"""Surfaces for tests: texture models that no texture has, and long realisations of any."""

import numpy as np

from mmt.testing.simulation.surfaces.known_surfaces import Stroke
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import InputSpace, TextureSamples


def odd_model(inputs="isotropic", count=25, order=6, seed=3, fastest_mm_s=300.0):
    """Return a model whose filters have nothing in common."""
    rng = np.random.default_rng(seed)
    space = InputSpace(inputs, fastest_mm_s, 3.0)
    lsf = np.sort(rng.uniform(0.1, np.pi - 0.1, (count, order)), axis=1)
    lsf += 0.02 * np.arange(order)
    lsf *= (np.pi - 0.05) / lsf.max()
    speed, force = rng.uniform(20, fastest_mm_s, count), rng.uniform(0.1, 3.0, count)
    heading = rng.uniform(-np.pi, np.pi, count)
    columns = [speed, force]
    if inputs == "anisotropic":
        columns = [speed * np.cos(heading), speed * np.sin(heading), force]
    power = rng.uniform(0.5, 5.0, count)
    return TextureModel(
        TextureSamples(np.column_stack(columns), lsf, power, power, space), method="published"
    )


def realisation(surface, stroke, frames, seed=3):
    """Return the vibration (n, 2), normal and along, of a constant stroke once it has settled."""
    source = surface.vibration(np.random.default_rng(seed))
    samples = round(surface.rate_hz / 1000.0)
    made = [source.run(samples, stroke) for _ in range(frames + 2000 // samples)]
    return np.concatenate(made[2000 // samples :])


def stroke_towards(speed_mm_s, force_n, heading_deg=0.0):
    heading = np.radians(heading_deg)
    return Stroke(speed_mm_s, force_n, (float(np.cos(heading)), float(np.sin(heading))))
