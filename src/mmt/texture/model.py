"""The texture model: autoregressive filters over the speed-force plane.

Awan et al., section V.B: the samples' filters, kept as line spectral frequencies (LSF), stand
at their mean speed and force, both divided by their maxima; the plane is Delaunay
triangulated, extended by boundary points on its four edges. A model never changes: modelling
builds a new one and hands it over by one assignment.
"""

import io
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from mmt.arrays import FloatArray, IntArray
from mmt.compiled import kernel
from mmt.errors import InputError
from mmt.texture.interpolation import Triangulation, locate, triangulate
from mmt.texture.lsf import lsf_inverse_gain
from mmt.texture.settings import (
    LARGEST_ORDER,
    MAXIMUM_FORCE_N,
    MAXIMUM_SPEED_MM_S,
    Interpolated,
)
from mmt.texture.spectra import lsf_spectrum
from mmt.texture.split import separate
from mmt.texture.vertices import vertex_table

FORMAT_VERSION: Final = 1
"""Of the ``.npz`` file that `TextureModel.save` writes."""

LEVELS: Final[dict[Interpolated, int]] = {"variance": 0, "power": 1, "amplitude": 2}
"""What is interpolated linearly, by its number in the compiled kernels."""

_FIRST_LSF = 3  # columns of the vertex table: x, y, level, then the LSF


@dataclass(frozen=True)
class TextureSamples:
    """Fitted segments.

    Attributes
    ----------
    speed_mm_s, force_n
        Mean speed and normal force of each segment, shape (n,).
    lsf
        Line spectral frequencies in radians, shape (n, order).
    variance
        Variance of the excitation in (m/s2)^2, shape (n,).
    power
        Mean square of the vibration in (m/s2)^2, shape (n,).
    """

    speed_mm_s: FloatArray
    force_n: FloatArray
    lsf: FloatArray
    variance: FloatArray
    power: FloatArray

    def __len__(self) -> int:
        return len(self.speed_mm_s)

    def normalised(self, maximum_speed_mm_s: float, maximum_force_n: float) -> FloatArray:
        """Return the samples' points in the unit square, shape (n, 2), clipped to it."""
        scaled = np.column_stack(
            [self.speed_mm_s / maximum_speed_mm_s, self.force_n / maximum_force_n]
        )
        return np.clip(scaled, 0.0, 1.0)


def _read_only(array: Any) -> FloatArray:
    copy = np.array(array, dtype=np.float64, order="C")
    copy.setflags(write=False)
    return copy


class TextureModel:
    """An immutable model: ask it for a filter or a spectrum at any speed and force.

    Parameters
    ----------
    samples
        At least one; copied. A sample beyond the maxima counts as lying on the edge.
    maximum_speed_mm_s, maximum_force_n
        Where the plane ends. Distances, the nearest sample of a boundary point included,
        are Euclidean in the plane divided by these two.
    interpolate
        What is linear inside a triangle: ``"variance"`` of the excitation (the published
        way), ``"power"`` of the vibration, or its ``"amplitude"``, the root of the power.
        With the latter two the variance follows from the interpolated filter's own gain.
    rate_hz
        Sampling rate of the filters.

    Raises
    ------
    InputError
        Shapes disagree, a number is not finite or negative, or an LSF set is not
        ascending inside (0, pi).
    """

    def __init__(
        self,
        samples: TextureSamples,
        *,
        maximum_speed_mm_s: float = MAXIMUM_SPEED_MM_S,
        maximum_force_n: float = MAXIMUM_FORCE_N,
        interpolate: Interpolated = "power",
        rate_hz: float = 1000.0,
    ) -> None:
        if interpolate not in LEVELS:
            raise InputError(f"interpolate is {interpolate!r}, allowed are {', '.join(LEVELS)}")
        _check(samples)
        self.samples = TextureSamples(
            *(
                _read_only(getattr(samples, name))
                for name in ("speed_mm_s", "force_n", "lsf", "variance", "power")
            )
        )
        self.maximum_speed_mm_s = float(maximum_speed_mm_s)
        self.maximum_force_n = float(maximum_force_n)
        self.interpolate: Interpolated = interpolate
        self.rate_hz = float(rate_hz)
        self.points = _read_only(self.samples.normalised(maximum_speed_mm_s, maximum_force_n))
        level = {
            "variance": self.samples.variance,
            "power": self.samples.power,
            "amplitude": np.sqrt(self.samples.power),
        }[interpolate]
        self.vertices = vertex_table(self.points, level, self.samples.lsf)
        self._triangulation = triangulate(self.vertices[:, :2])

    @property
    def order(self) -> int:
        """The order that all filters share."""
        return int(self.samples.lsf.shape[1])

    @property
    def triangles(self) -> IntArray:
        """Corners and neighbours, shape (t, 6); see `Triangulation`."""
        return self._triangulation.triangles

    @cached_property
    def triangulation(self) -> Triangulation:
        """The triangulation of samples and boundary points, in the unit square."""
        return self._triangulation

    def at(
        self, speed_mm_s: FloatArray | float, force_n: FloatArray | float
    ) -> tuple[FloatArray, FloatArray]:
        """Interpolate the filter.

        Parameters
        ----------
        speed_mm_s, force_n
            Shape (k,) or scalars; clipped to the plane, NaN counts as zero.

        Returns
        -------
        lsf, variance
            Shapes (k, order) and (k,).
        """
        speed, force = np.broadcast_arrays(
            np.atleast_1d(np.asarray(speed_mm_s, dtype=np.float64)),
            np.atleast_1d(np.asarray(force_n, dtype=np.float64)),
        )
        x = np.nan_to_num(speed / self.maximum_speed_mm_s, posinf=1.0, neginf=0.0)
        y = np.nan_to_num(force / self.maximum_force_n, posinf=1.0, neginf=0.0)
        queries = np.ascontiguousarray(np.clip(np.column_stack([x, y]), 0.0, 1.0))
        lsf = np.empty((len(queries), self.order))
        variance = np.empty(len(queries))
        _interpolate_many(
            self.vertices, self.triangles, LEVELS[self.interpolate], queries, lsf, variance
        )
        return lsf, variance

    def spectrum(
        self,
        speed_mm_s: FloatArray | float,
        force_n: FloatArray | float,
        frequencies_hz: FloatArray,
    ) -> FloatArray:
        """Return the one-sided power spectral density in (m/s2)^2/Hz, shape (k, f)."""
        lsf, variance = self.at(speed_mm_s, force_n)
        return lsf_spectrum(lsf, variance, frequencies_hz, self.rate_hz)

    def save(self, path: Path) -> None:
        """Write the model as ``.npz``; the layout is in ``docs/reference/model-file.md``."""
        path.write_bytes(self.to_bytes())

    def to_bytes(self) -> bytes:
        """Return what `save` writes."""
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            format_version=np.int64(FORMAT_VERSION),
            speed_mm_s=self.samples.speed_mm_s,
            force_n=self.samples.force_n,
            lsf_rad=self.samples.lsf,
            variance=self.samples.variance,
            power=self.samples.power,
            maximum_speed_mm_s=np.float64(self.maximum_speed_mm_s),
            maximum_force_n=np.float64(self.maximum_force_n),
            rate_hz=np.float64(self.rate_hz),
            interpolate=np.str_(self.interpolate),
        )
        return buffer.getvalue()

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            The file is missing, is no model, has another version, or holds bad numbers.
        """
        try:
            return cls.from_bytes(path.read_bytes())
        except OSError as error:
            raise InputError(f"model {path}: {error.strerror or error}") from error
        except InputError as error:
            raise InputError(f"model {path}: {error}") from error

    @classmethod
    def from_bytes(cls, data: bytes) -> Self:
        """Rebuild a model from `to_bytes`; raises `InputError` as `load` does."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                content = {name: arrays[name] for name in arrays.files}
        except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
            raise InputError("not a texture model (.npz), or cut off") from error
        version = int(content.get("format_version", 0))
        if version != FORMAT_VERSION:
            raise InputError(f"format version is {version}, this program reads {FORMAT_VERSION}")
        try:
            samples = TextureSamples(
                content["speed_mm_s"],
                content["force_n"],
                content["lsf_rad"],
                content["variance"],
                content["power"],
            )
            return cls(
                samples,
                maximum_speed_mm_s=float(content["maximum_speed_mm_s"]),
                maximum_force_n=float(content["maximum_force_n"]),
                interpolate=str(content["interpolate"]),  # type: ignore[arg-type]
                rate_hz=float(content["rate_hz"]),
            )
        except KeyError as error:
            raise InputError(f"the array {error} is missing") from error


def _check(samples: TextureSamples) -> None:
    lsf = np.asarray(samples.lsf)
    if lsf.ndim != 2 or not 1 <= lsf.shape[1] <= LARGEST_ORDER or not len(lsf):
        raise InputError(f"lsf has shape {lsf.shape}: at least one sample of order 1 to 64 needed")
    for name in ("speed_mm_s", "force_n", "variance", "power"):
        values = np.asarray(getattr(samples, name))
        if values.shape != (len(lsf),):
            raise InputError(f"{name} has shape {values.shape}, ({len(lsf)},) needed")
        if not np.isfinite(values).all() or (values < 0).any():
            raise InputError(f"{name} must be finite and not negative")
    inside = np.isfinite(lsf).all() and (lsf > 0).all() and (lsf < np.pi).all()
    if not inside or (np.diff(lsf, axis=1) <= 0).any():
        raise InputError("lsf must ascend strictly inside (0, pi)")


@kernel("f8(f8[:, ::1], i8[:, ::1], i8, f8[::1], f8[::1])")
def interpolate_lsf(
    vertices: FloatArray,
    triangles: IntArray,
    triangle: int,
    weights: FloatArray,
    lsf: FloatArray,
) -> float:
    """Write the LSF (order,) inside a triangle; return the level.

    Frequencies that rounding has let meet are moved apart by a rounding.
    """
    level = 0.0
    lsf[:] = 0.0
    for corner in range(3):
        vertex = triangles[triangle, corner]
        weight = weights[corner]
        level += weight * vertices[vertex, 2]
        for index in range(len(lsf)):
            lsf[index] += weight * vertices[vertex, _FIRST_LSF + index]
    before = 0.0
    for index in range(len(lsf)):
        if not before < lsf[index] < np.pi:
            separate(lsf)
            break
        before = lsf[index]
    return level


@kernel("f8(f8, i8, f8[::1], f8[::1])")
def _excitation_variance(level: float, level_kind: int, lsf: FloatArray, work: FloatArray) -> float:
    """Return the excitation's variance: the gain of a mean of LSF is no mean of gains."""
    if level_kind == 0 or level == 0.0:
        return level
    if level_kind == 2:
        level *= level
    return level * lsf_inverse_gain(lsf, work)


@kernel("void(f8[:, ::1], i8[:, ::1], i8, f8[:, ::1], f8[:, ::1], f8[::1])")
def _interpolate_many(
    vertices: FloatArray,
    triangles: IntArray,
    level_kind: int,
    queries: FloatArray,
    lsf: FloatArray,
    variance: FloatArray,
) -> None:
    weights = np.empty(3)
    work = np.empty(2 * LARGEST_ORDER)
    triangle = 0
    for index in range(queries.shape[0]):
        triangle = locate(
            vertices, triangles, triangle, queries[index, 0], queries[index, 1], weights
        )
        level = interpolate_lsf(vertices, triangles, triangle, weights, lsf[index])
        variance[index] = _excitation_variance(level, level_kind, lsf[index], work)
