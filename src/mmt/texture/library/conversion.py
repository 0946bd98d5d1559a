"""Known textures in the input space of a model that is being built.

A model of a library may be a function of the velocity where the local one is a function of the
speed, or the other way round. It is laid over a grid of the local space then: a model of the
speed is the same at all headings, and of a model of the velocity the mean over headings is
taken, of its spectra, and the filter of the same order that has its autocorrelations.
"""

from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.forms import lsf_to_reflection, output_power, reflection_to_lsf
from mmt.texture.autoregression.reshaping import (
    LARGEST_REFLECTION,
    PERIOD,
    reflection_of,
)
from mmt.texture.autoregression.spectra import lsf_spectrum
from mmt.texture.model.inputs import InputSpace
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel

_SPEEDS: Final = np.array([0.03, 0.06, 0.1, 0.2, 0.35, 0.6, 1.0])
_FORCES: Final = np.array([0.03, 0.08, 0.2, 0.4, 0.7, 1.0])
_DIRECTED_SPEEDS: Final = np.array([0.06, 0.15, 0.4, 1.0])
_DIRECTED_FORCES: Final = np.array([0.05, 0.2, 0.5, 1.0])
_HEADINGS: Final = 12
_MEAN_HEADINGS: Final = 8
_LEAST_POWER: Final = 1e-12  # (m/s2)^2, a millionth of what can be felt
_LARGEST_LOGARITHM: Final = 30.0  # beyond what anything can play
_SPECTRUM: Final = np.arange(PERIOD // 2 + 1) / PERIOD  # cycles a sample


class Field(NamedTuple):
    """ln(power) of k strokes, shape (k,), and reflection coefficients, shape (k, order)."""

    logarithm: FloatArray
    reflection: FloatArray


def grid(space: InputSpace) -> FloatArray:
    """Return inputs (k, d) that cover a space, denser where speed and force are small.

    Rings of headings are turned against each other, so that few of them lie on one sphere.
    """
    if not space.directed:
        mesh = np.meshgrid(_SPEEDS, _FORCES, indexing="ij")
        return np.stack([axis.ravel() for axis in mesh], axis=-1) * space.scale
    rings = []
    for row, speed in enumerate(_DIRECTED_SPEEDS):
        for column, force in enumerate(_DIRECTED_FORCES):
            turns = np.arange(_HEADINGS) + 0.5 * ((row + column) % 2)
            heading = 2.0 * np.pi * turns / _HEADINGS
            across = np.full(_HEADINGS, force)
            rings.append(np.stack([speed * np.cos(heading), speed * np.sin(heading), across], 1))
    return np.concatenate(rings) * space.scale


def field(model: TextureModel, space: InputSpace, inputs: FloatArray) -> Field:
    """Return level and filters of a model at inputs (k, d) of a space, its own or the other."""
    if model.space.directed and not space.directed:
        return _mean_over_headings(model, inputs)
    own = inputs
    if space.directed and not model.space.directed:
        own = np.stack([space.speed_mm_s(inputs), inputs[:, -1]], axis=-1)
    lsf, variance = model.at(*own.T)
    reflection = lsf_to_reflection(lsf)
    power = output_power(variance, reflection)
    return Field(np.log(np.maximum(power, _LEAST_POWER)), reflection)


def model_of(of: Field, space: InputSpace, inputs: FloatArray, rate_hz: float) -> TextureModel:
    """Return a model that has a field at inputs (k, d) and interpolates in between."""
    reflection = np.clip(of.reflection, -LARGEST_REFLECTION, LARGEST_REFLECTION)
    power = np.exp(np.clip(of.logarithm, np.log(_LEAST_POWER), _LARGEST_LOGARITHM))
    samples = TextureSamples(
        inputs=inputs,
        lsf=reflection_to_lsf(reflection),
        variance=power * np.prod(1.0 - np.square(reflection), axis=1),
        power=power,
        space=space,
    )
    return TextureModel(samples, rate_hz=rate_hz)


def into_space(model: TextureModel, space: InputSpace) -> TextureModel:
    """Return a model over the grid of a space; itself where it is of that space."""
    if model.space == space:
        return model
    inputs = grid(space)
    return model_of(field(model, space, inputs), space, inputs, model.rate_hz)


def _mean_over_headings(model: TextureModel, inputs: FloatArray) -> Field:
    turns = 2.0 * np.pi * np.arange(_MEAN_HEADINGS) / _MEAN_HEADINGS
    speed, force = np.repeat(inputs, _MEAN_HEADINGS, axis=0).T
    heading = np.tile(turns, len(inputs))
    lsf, variance = model.at(speed * np.cos(heading), speed * np.sin(heading), force)
    density = lsf_spectrum(lsf, variance, _SPECTRUM, 1.0)
    mean = density.reshape(len(inputs), _MEAN_HEADINGS, -1).mean(axis=1)
    reflection, power = reflection_of(mean, model.order)
    return Field(np.log(np.maximum(power, _LEAST_POWER)), reflection)
