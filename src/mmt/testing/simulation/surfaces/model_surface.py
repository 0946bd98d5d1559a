"""A texture model as a surface of known texture: a truth that this project did not draw.

A model's filters lie at points of speed and force, or of velocity and force. The texture's spectrum
between them is the barycentric mean of the spectra at the corners of the simplex; a sum of
independent filtered noises has exactly this spectrum. No texture model interpolates in this way.
The model's range is stretched to that of a session, 300 mm/s and 3 N.
"""

import base64
from collections.abc import Mapping
from functools import lru_cache
from math import sqrt
from operator import mul
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.session.formats import find_format
from mmt.testing.simulation import RATE_HZ
from mmt.testing.simulation.surfaces.known_surfaces import (
    MODEL_VERSION,
    KnownSurface,
    Stroke,
    VibrationSource,
    encode_truth,
)
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import InputSpace


@kernel("void(f8[:, ::1], f8[:, ::1], f8[:, ::1], i8)")
def filter_side_by_side(
    backward: FloatArray, noise: FloatArray, outputs: FloatArray, start: int
) -> None:
    """Append the next outputs of filters to their last ones; about 0.2 ns for each order.

    Parameters
    ----------
    backward
        Coefficients (order, filters), that of the oldest output first.
    noise
        Input of each filter, (n, filters).
    outputs
        Outputs (m, filters), m at least start + order + n. The `order` rows from `start` on are the
        last ones, and the n rows behind them are written.
    start
        Row of the oldest output that counts.
    """
    order, filters = backward.shape
    for sample in range(len(noise)):
        now = outputs[start + sample + order]
        for place in range(filters):
            now[place] = 0.0
        for lag in range(order):
            coefficients, past = backward[lag], outputs[start + sample + lag]
            for place in range(filters):
                now[place] += coefficients[place] * past[place]
        for place in range(filters):
            now[place] = noise[sample, place] - now[place]


_BLOCK = 100  # samples at once, at most
_RUN_IN_S = 2.0
_OUTSIDE = -1e-9
"""Least weight of a point inside a simplex, because of rounding."""


class ModelSurface(KnownSurface):
    """A texture model as the texture of a surface.

    Parameters
    ----------
    name
        Name in reports.
    model
        Texture model of any rate; its filters are resampled to `rate_hz`.
    tangential_share, friction_coefficient, rate_hz
        See `KnownSurface`.

    Raises
    ------
    InputError
        The model's points do not span its space.
    """

    def __init__(
        self,
        name: str,
        model: TextureModel,
        tangential_share: float = 0.3,
        friction_coefficient: float = 0.3,
        rate_hz: float = RATE_HZ,
    ) -> None:
        from scipy.spatial import Delaunay, QhullError

        from mmt.texture.autoregression.forms import lsf_to_ar

        self.name = name
        self.rate_hz = rate_hz
        self.model = model
        self.tangential_share = tangential_share
        self.friction_coefficient = friction_coefficient
        self.space = InputSpace(model.space.name)
        self.points = np.ascontiguousarray(model.vertices[:, : model.dimensions])
        lsf, self.variance = model.at_rate(rate_hz).at(*(self.points * model.space.scale).T)
        self.coefficients: FloatArray = lsf_to_ar(lsf)
        """Shape (v, order): x[t] + c[0] x[t - 1] + ... = e[t]."""
        try:
            self._simplices = Delaunay(self.points)
        except QhullError as error:
            raise InputError(f"surface {name}: its points lie on a line") from error

    @property
    def isotropic(self) -> bool:
        """Whether the model is one over speed, not velocity."""
        return not self.model.space.directed

    def spectrum(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        frequencies_hz: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the exact spectrum along the normal, (k, f); see `KnownSurface.spectrum`."""
        from mmt.texture.autoregression.forms import ar_spectrum

        frequencies = np.atleast_1d(np.asarray(frequencies_hz, np.float64))
        corners, weights = self.weights(self._inputs(speed_mm_s, force_n, heading_rad))
        used, places = np.unique(corners, return_inverse=True)
        each = ar_spectrum(self.coefficients[used], self.variance[used], frequencies, self.rate_hz)
        density: FloatArray = np.einsum("kc,kcf->kf", weights, each[places.reshape(corners.shape)])
        return density

    def power(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the exact power along the normal, (k,), (m/s2)^2; see `KnownSurface.power`."""
        from mmt.texture.autoregression.forms import ar_to_reflection, output_power

        corners, weights = self.weights(self._inputs(speed_mm_s, force_n, heading_rad))
        each = output_power(self.variance, ar_to_reflection(self.coefficients))
        total: FloatArray = np.sum(weights * each[corners], axis=1)
        return total

    def weights(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the corners (k, d + 1) around points (k, d) of the unit space, and weights.

        A point that rounding puts outside all simplices gets the nearest corner.
        """
        found = self._simplices.find_simplex(points, tol=1e-12)
        transform = self._simplices.transform[found]
        first = np.einsum("kij,kj->ki", transform[:, :-1], points - transform[:, -1])
        weights = np.hstack([first, 1.0 - first.sum(axis=1, keepdims=True)]).clip(0.0, 1.0)
        corners = self._simplices.simplices[found].astype(np.int64)
        for row in np.flatnonzero((found < 0) | ~np.isfinite(weights).all(axis=1)):
            away = np.linalg.norm(self.points - points[row], axis=1)
            corners[row], weights[row] = int(np.argmin(away)), 0.0
            weights[row, 0] = 1.0
        return corners, weights / weights.sum(axis=1, keepdims=True)

    def simplex(self, point: tuple[float, ...]) -> "_Simplex":
        """Return the simplex around a point (d,) of the unit space, or the nearest corner."""
        number = int(self._simplices.find_simplex(point, tol=1e-12))
        transform = self._simplices.transform[number]
        if number < 0 or not np.isfinite(transform).all():
            nearest = int(np.argmin(np.linalg.norm(self.points - point, axis=1)))
            return _Simplex([nearest], [], [])
        corners = self._simplices.simplices[number].tolist()
        return _Simplex(corners, transform[:-1].tolist(), transform[-1].tolist())

    def annotations(self) -> bytes:
        """Return the truth as JSON, from which `from_parameters` rebuilds it."""
        parameters = {
            "tangential_share": self.tangential_share,
            "friction_coefficient": self.friction_coefficient,
            **({} if self.rate_hz == RATE_HZ else {"rate_hz": self.rate_hz}),
            "model_npz": base64.b64encode(self.model.to_bytes()).decode(),
        }
        return encode_truth(self.name, MODEL_VERSION, parameters)

    def vibration(self, generator: np.random.Generator) -> "ModelVibration":
        """Return a generator of its vibration."""
        return ModelVibration(self, generator)

    def _inputs(
        self,
        speed_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
        heading_rad: npt.ArrayLike | None,
    ) -> FloatArray:
        speed, force, cosine, sine = self._strokes(speed_mm_s, force_n, heading_rad)
        return self.space.normalise(self.space.from_motion(speed * cosine, speed * sine, force))


def from_parameters(name: str, parameters: Mapping[str, Any]) -> ModelSurface:
    """Rebuild the surface from the parameters of `ModelSurface.annotations`.

    Raises
    ------
    InputError, ValueError, KeyError, TypeError
        The parameters do not describe a model.
    """
    model = TextureModel.from_bytes(base64.b64decode(parameters["model_npz"], validate=True))
    share, friction = float(parameters["tangential_share"]), parameters["friction_coefficient"]
    rate_hz = float(parameters.get("rate_hz", RATE_HZ))
    return ModelSurface(name, model, share, float(friction), rate_hz)


class ReadModel(Protocol):
    """Result of a reader of another program's models."""

    @property
    def model(self) -> TextureModel:
        """The texture."""

    @property
    def friction(self) -> float | None:
        """Coefficient of kinetic friction, None if the file has none."""


@lru_cache(maxsize=32)
def load_surface(path: str, rate_hz: float = RATE_HZ) -> ModelSurface:
    """Return the surface of a model file at a rate, in mmt's format or another that can be read.

    Raises
    ------
    InputError
        The file is missing or holds no model.
    """
    file = Path(path)
    read = find_format("model", file)
    if read is not None:
        imported: ReadModel = read(file)
        friction = 0.3 if imported.friction is None else imported.friction
        return ModelSurface(
            file.stem, imported.model, friction_coefficient=friction, rate_hz=rate_hz
        )
    return ModelSurface(file.stem, TextureModel.load(file), rate_hz=rate_hz)


class _Simplex(NamedTuple):
    """Corners (d + 1) with the matrix (d, d) and origin (d,) of their barycentric weights."""

    corners: list[int]
    matrix: list[list[float]]
    origin: list[float]

    def weights(self, point: tuple[float, ...]) -> list[float] | None:
        """Return the corners' weights, or None if the point lies outside."""
        if not self.matrix:
            return None
        off = [here - zero for here, zero in zip(point, self.origin, strict=True)]
        found = [sum(map(mul, row, off)) for row in self.matrix]
        found.append(1.0 - sum(found))
        return found if min(found) >= _OUTSIDE else None


class ModelVibration(VibrationSource):
    """A generator whose stationary spectrum is exactly `ModelSurface.spectrum`.

    A noise is filtered at each of the model's points, whatever the motion; the motion's point sets
    the weights of their sum. The filters are stable, since they come from line spectral
    frequencies. Cost with the 362 points of a model of velocity: some 20 us a tick at 1 kHz,
    order 16, and 230 us at 10 kHz, order 64; 20 us more when the motion enters another simplex.
    """

    def __init__(self, surface: ModelSurface, generator: np.random.Generator) -> None:
        self._surface = surface
        self._share = surface.tangential_share
        self._generator = generator
        # two columns for each point: along the normal and along the heading
        self._deviation = np.sqrt(surface.variance).repeat(2)
        self._order = surface.coefficients.shape[1]
        backward = surface.coefficients.T[::-1].repeat(2, axis=1)
        self._backward = np.ascontiguousarray(backward)
        self._outputs = np.zeros((_BLOCK + self._order, len(self._deviation)))
        self._start = 0
        self._simplex = surface.simplex((0.0,) * surface.model.dimensions)
        for _ in range(round(_RUN_IN_S * surface.rate_hz / _BLOCK)):
            self._advance(_BLOCK)

    def run(self, count: int, stroke: Stroke) -> list[tuple[float, float]]:
        """Return the next samples; see `VibrationSource.run`."""
        point = self._point(stroke)
        weights = self._simplex.weights(point)
        if weights is None:
            self._simplex = self._surface.simplex(point)
            weights = self._simplex.weights(point) or [1.0]
        corners = [
            (corner, sqrt(max(weight, 0.0)))
            for corner, weight in zip(self._simplex.corners, weights, strict=False)
        ]
        made: list[tuple[float, float]] = []
        while len(made) < count:
            outputs = self._advance(min(count - len(made), _BLOCK))
            made += [self._summed(row, corners) for row in outputs]
        return made

    def _summed(self, outputs: FloatArray, corners: list[tuple[int, float]]) -> tuple[float, float]:
        normal_sum = along_sum = 0.0
        for corner, amplitude in corners:
            normal, along = outputs[2 * corner : 2 * corner + 2].tolist()
            normal_sum += amplitude * normal
            along_sum += amplitude * along
        return normal_sum, self._share * along_sum

    def _advance(self, count: int) -> FloatArray:
        """Return the next outputs of every filter, (count, 2 v); at most `_BLOCK`."""
        start, order = self._start, self._order
        if start + order + count > len(self._outputs):
            self._outputs[:order] = self._outputs[start : start + order]
            start = 0
        noise = self._deviation * self._generator.standard_normal((count, len(self._deviation)))
        filter_side_by_side(self._backward, noise, self._outputs, start)
        self._start = start + count
        return self._outputs[start + order : start + order + count]

    def _point(self, stroke: Stroke) -> tuple[float, ...]:
        space, (u, v) = self._surface.space, stroke.heading
        speed = min(max(stroke.speed_mm_s / space.maximum_speed_mm_s, 0.0), 1.0)
        force = min(max(stroke.force_n / space.maximum_force_n, 0.0), 1.0)
        return (speed, force) if self._surface.isotropic else (u * speed, v * speed, force)
