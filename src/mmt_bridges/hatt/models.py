"""Convert texture models from and to files of the Penn Haptic Texture Toolkit (HaTT).

The all-pole filter of an order that predicts a signal best has the first autocorrelations of the
signal's spectrum (`mmt.texture.autoregression.burg`). A higher order brings its own spectrum
nearer to that; zeros near the unit circle take many poles.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import InputError, naming
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.burg import reflection_of
from mmt.texture.autoregression.forms import (
    lsf_to_ar,
    lsf_to_reflection,
    output_power,
    reflection_to_ar,
    reflection_to_lsf,
)
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.space import InputSpace
from mmt_bridges.hatt.file import HattModelSet, format_hatt, read_hatt

_CLOSE_DB: Final = 0.1
_FLOOR_DB: Final = 60.0
"""Depth below their maximum to which spectra are compared: at zeros they fall without bound."""
_TRANSFORM: Final = 2**15
"""Samples after which autocorrelations repeat: those of the sharpest lines have decayed."""


class AllPole(NamedTuple):
    """All-pole filters of one order that approximate others.

    ``reflection`` (n, order), ``variance`` (n,) of the excitation, and ``error_db`` (n,): the
    root mean square over frequency of the difference between the spectra in dB.
    """

    reflection: FloatArray
    variance: FloatArray
    error_db: FloatArray


def all_pole(ar: FloatArray, ma: FloatArray, variance: FloatArray) -> AllPole:
    """Return all-pole filters of one order whose spectra are near those of filters with zeros.

    The order is the least, from that of the poles up to 64, at which no spectrum differs by
    more than 0.1 dB, root mean square over frequency; if there is none, 64.

    Parameters
    ----------
    ar
        a[0] ... a[p-1] of ``A(z) = 1 + sum a[j] z^-(j+1)``, stable, shape (n, p).
    ma
        c[0] ... c[q] of ``C(z)``, shape (n, q + 1).
    variance
        Variance of the excitation, shape (n,).
    """
    wanted = _square(ma) / _square(np.insert(ar, 0, 1.0, axis=1))
    reflection, power = reflection_of(2.0 * wanted, LARGEST_ORDER)
    left = power[:, None] * np.cumprod((1.0 - reflection) * (1.0 + reflection), axis=1)
    floor = wanted.max(axis=1, keepdims=True) * 10.0 ** (-_FLOOR_DB / 10.0)
    for order in range(ar.shape[1], LARGEST_ORDER + 1):
        poles = reflection_to_ar(reflection[:, :order])
        found = left[:, order - 1 : order] / _square(np.insert(poles, 0, 1.0, axis=1))
        ratio = np.maximum(found, floor) / np.maximum(wanted, floor)
        error_db = np.sqrt(np.mean(np.square(10.0 * np.log10(ratio)), axis=1))
        if error_db.max() <= _CLOSE_DB:
            break
    return AllPole(reflection[:, :order], left[:, order - 1] * variance, error_db)


def _square(coefficients: FloatArray) -> FloatArray:
    """Return squared magnitudes (n, f) at even angles from 0 to pi."""
    return np.asarray(np.square(np.abs(np.fft.rfft(coefficients, _TRANSFORM, axis=1))))


@dataclass(frozen=True)
class ImportedModel:
    """An imported model, and how it differs from the file.

    Attributes
    ----------
    model
        The imported model.
    material
        Name of the texture in the file.
    friction
        Coefficient of kinetic friction, or None if the file has none; the model does not use it.
    zeros
        Number of zeros of each filter in the file, which all-pole filters approximate here.
    spectrum_error_db
        Error of this approximation: the largest of all filters, as the root mean square over
        frequency in dB; 0 without zeros.
    same_triangles
        Share of the file's triangles that the model's triangulation has too, or None if the file
        has no triangles.
    """

    model: TextureModel
    material: str
    friction: float | None
    zeros: int
    spectrum_error_db: float
    same_triangles: float | None


def import_hatt(path: Path) -> ImportedModel:
    """Import a model from a file of HaTT.

    Every vertex of the file, its boundary points included, becomes a sample. The plane is
    triangulated again, on axes divided by the file's maxima. Filters with zeros are replaced by
    all-pole filters of a higher order, see `all_pole`.

    Parameters
    ----------
    path
        An XML file.

    Raises
    ------
    InputError
        The file cannot be read or holds no valid model; the message says why.
    """
    content = read_hatt(path)
    with naming(f"model {path}"):
        samples, error_db = _samples(content)
        model = TextureModel(samples, method="published", rate_hz=content.rate_hz)
    return ImportedModel(
        model,
        content.material,
        content.friction,
        content.zeros.shape[1] - 1,
        error_db,
        _same_triangles(content, model),
    )


def export_hatt(model: TextureModel, material: str, friction: float | None = None) -> bytes:
    """Return a model as an XML file, for the toolkit's own programs.

    The vertices are the model's samples and boundary points; the triangles are the model's.

    Parameters
    ----------
    model
        A model of speed and force.
    material
        The texture's name.
    friction
        Coefficient of kinetic friction, left out if None.

    Raises
    ------
    InputError
        The model depends on the heading, which the toolkit's files cannot hold.
    """
    space = model.space
    if space.directed:
        raise InputError(
            "the model depends on the heading: files of HaTT hold models of speed and force"
        )
    inputs = model.vertices[:, :2] * space.scale
    _, variance = model.at(inputs[:, 0], inputs[:, 1])
    return format_hatt(
        HattModelSet(
            material=material,
            rate_hz=model.rate_hz,
            friction=friction,
            maximum_speed_mm_s=space.maximum_speed_mm_s,
            maximum_force_n=space.maximum_force_n,
            speed_mm_s=inputs[:, 0],
            force_n=inputs[:, 1],
            lsf=model.vertices[:, 3:],
            zeros=np.ones((len(inputs), 1)),
            variance=variance,
            triangles=model.triangulation.triangles[:, :3],
        )
    )


def _samples(content: HattModelSet) -> tuple[TextureSamples, float]:
    """Return the vertices as samples, and the largest error of their spectra in dB."""
    lsf, error_db = content.lsf, 0.0
    variance = content.variance * content.zeros[:, 0] ** 2
    if content.zeros.shape[1] > 1:
        poles = all_pole(lsf_to_ar(lsf), content.zeros, content.variance)
        reflection, variance = poles.reflection, poles.variance
        lsf, error_db = reflection_to_lsf(reflection), float(poles.error_db.max())
    else:
        reflection = lsf_to_reflection(lsf)
    space = InputSpace("isotropic", content.maximum_speed_mm_s, content.maximum_force_n)
    samples = TextureSamples(
        np.column_stack([content.speed_mm_s, content.force_n]),
        lsf,
        variance,
        output_power(variance, reflection),
        space,
    )
    return samples, error_db


def _same_triangles(content: HattModelSet, model: TextureModel) -> float | None:
    if not len(content.triangles):
        return None
    points = model.vertices[:, :2]
    wanted = model.points[content.triangles]
    vertex = np.linalg.norm(points[None, None] - wanted[:, :, None], axis=-1).argmin(axis=-1)
    found = _sets(model.triangulation.triangles[:, :3])
    return len(_sets(vertex) & found) / len(content.triangles)


def _sets(triangles: IntArray) -> set[frozenset[int]]:
    return {frozenset(map(int, corners)) for corners in triangles}
