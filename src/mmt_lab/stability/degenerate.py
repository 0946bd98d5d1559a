"""Arrangements of samples that are few, coincident, collinear or many, and models of them."""

import math
from collections.abc import Iterator
from itertools import product
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import output_power, reflection_to_lsf
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import Method
from mmt.texture.space import ANISOTROPIC, ISOTROPIC, InputSpace, TextureSamples

_ORDER: Final = 10


def of_plane(many: int) -> Iterator[tuple[str, FloatArray]]:
    """Yield named points (n, 2) of the unit square, some of them outside."""
    generator = np.random.default_rng(3)
    along = np.linspace(0.05, 0.95, 30)
    for count in (1, 2, 3):
        yield f"{count} sample{'s' if count > 1 else ''}", generator.uniform(0.1, 0.9, (count, 2))
    yield "50 samples, all equal", np.tile((0.4, 0.6), (50, 1))
    yield "30 on a diagonal", np.column_stack([along, along])
    yield "30 of one force", np.column_stack([along, np.full(30, 0.5)])
    yield "30 of one speed", np.column_stack([np.full(30, 1.0 / 3.0), along])
    edge = np.linspace(0.0, 1.0, 31)
    yield "31 on the edge of largest force", np.column_stack([edge, np.ones(31)])
    yield "31 on the edge of zero speed", np.column_stack([np.zeros(31), edge])
    yield "4 on the corners", np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)])
    for inside in (1e-7, 1e-12, 1e-16):
        beside = np.column_stack([generator.uniform(0.0, 1.0, 30), np.full(30, 1.0 - inside)])
        yield f"30 at {inside:g} inside an edge", beside
    yield "3 beyond the maxima", np.array([(5.0, 0.5), (10.0, 7.0), (0.5, 30.0)])
    for apart in (1e-6, 1e-9, 1e-12, 1e-15):
        # Half a cell off the grid by which coincident samples are found.
        centres = (np.round(generator.uniform(0.1, 0.9, (20, 2)) * 1e6) + 0.5) / 1e6
        cross = 0.5 * apart * np.array([(-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
        yield f"20 times 4 samples {apart:g} apart", (centres[:, None] + cross).reshape(-1, 2)
    turn = np.linspace(0.0, 2.0 * np.pi, 500, endpoint=False)
    yield "500 on a circle", 0.5 + 0.4 * np.column_stack([np.cos(turn), np.sin(turn)])
    side = round(math.sqrt(many))
    ticks = np.linspace(0.0, 1.0, side)
    lattice = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    yield f"{side} x {side} on a grid", lattice
    yield f"{many} samples", generator.uniform(0.0, 1.0, (many, 2))
    yield f"{many} within 1e-3 of the plane", 0.3 + 1e-3 * generator.uniform(0.0, 1.0, (many, 2))


def of_space(many: int) -> Iterator[tuple[str, FloatArray]]:
    """Yield named points (n, 3) of the unit cylinder, some of them outside."""
    generator = np.random.default_rng(3)
    along = np.linspace(0.05, 0.95, 30)
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    for count in (1, 2, 3, 4):
        yield f"{count} sample{'s' if count > 1 else ''}", random_points(count, generator)
    yield "50 samples, all equal", np.tile((0.4, -0.2, 0.6), (50, 1))
    yield "30 on a line through rest", np.outer(along, (0.6, 0.5, 0.9))
    yield "30 of one velocity", np.column_stack([np.full((30, 2), 0.4), along])
    yield "60 of one heading, to and fro", _polar(np.where(turn < np.pi, 0.7, 0.7 + np.pi), turn)
    yield (
        "60 of one force",
        np.column_stack([random_points(60, generator)[:, :2], np.full(60, 0.5)]),
    )
    tilted = random_points(60, generator)
    tilted[:, 2] = 0.5 + 0.3 * tilted[:, 0] - 0.2 * tilted[:, 1]
    yield "60 on a tilted plane", tilted
    yield "60 of one speed and force", np.column_stack([0.5 * _circle(turn), np.full(60, 0.5)])
    yield "60 at the largest speed", np.column_stack([_circle(turn), turn / 7.0])
    yield "30 at rest", np.column_stack([np.zeros((30, 2)), along])
    yield "60 without force", np.column_stack([random_points(60, generator)[:, :2], np.zeros(60)])
    yield (
        "60 within 1e-9 of one force",
        np.column_stack(
            [random_points(60, generator)[:, :2], 0.5 + 1e-9 * generator.uniform(-1.0, 1.0, 60)]
        ),
    )
    yield "3 beyond the maxima", np.array([(5.0, 0.0, 0.5), (-7.0, 7.0, 10.0), (0.1, -3.0, 30.0)])
    for apart in (1e-3, 1e-5, 2e-6, 1e-6, 1e-9, 1e-15):
        centres = random_points(20, generator) * 0.9
        centres = (np.round(centres * 1e6) + 0.5) / 1e6  # off the grid of coincident samples
        corners = 0.5 * apart * np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
        yield f"20 times 4 samples {apart:g} apart", (centres[:, None] + corners).reshape(-1, 3)
    ticks = np.linspace(-0.7, 0.7, 5)
    yield "5 x 5 x 5 on a grid", np.array(list(product(ticks, ticks, 0.5 + 0.5 * ticks)))
    yield f"{many} samples", random_points(many, generator)
    yield f"{many} within 1e-3 of the space", 0.3 + 1e-3 * random_points(many, generator)


def random_points(count: int, generator: np.random.Generator) -> FloatArray:
    """Return points (count, 3) of the unit cylinder, none of them nearly at rest."""
    speed, force = generator.uniform(0.05, 1.0, count), generator.uniform(0.05, 1.0, count)
    return np.column_stack([speed[:, None] * _circle(generator.uniform(0, 7, count)), force])


def _circle(turn: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(turn), np.sin(turn)])


def _polar(heading: FloatArray, turn: FloatArray) -> FloatArray:
    """Return strokes (n, 3) with given headings, each with another speed and force."""
    speed, force = 0.5 + 0.45 * np.sin(5.0 * turn), 0.5 + 0.4 * np.cos(3.0 * turn)
    return np.column_stack([speed[:, None] * _circle(heading), force])


def build(
    points: FloatArray,
    method: Method = "published",
    space: InputSpace | None = None,
    scale: float = 1.0,
) -> TextureModel:
    """Return a model with random filters of order 10 and random levels.

    Parameters
    ----------
    points
        Normalised points, (n, 2) of the plane or (n, 3) of the cylinder.
    method
        How the samples are rendered.
    space
        The input space, by default the one with the dimensions of the points.
    scale
        Factor of all levels.
    """
    if space is None:
        space = ISOTROPIC if points.shape[1] == 2 else ANISOTROPIC
    generator = np.random.default_rng(len(points))
    k = generator.uniform(-0.9, 0.9, (len(points), _ORDER))
    power = scale * generator.uniform(0.5, 2.0, len(points))
    samples = TextureSamples(
        points * space.scale, reflection_to_lsf(k), power / output_power(1.0, k), power, space
    )
    return TextureModel(samples, method=method)
