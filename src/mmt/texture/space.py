"""Input space of a texture model, and the fitted segments in it, of which the model is built.

An isotropic texture depends on speed and normal force (paper A); an anisotropic one on the
velocity vector in the plane of the surface and on normal force (Abdulali and Jeon, paper B).
Both are made dimensionless by the same two numbers, 300 mm/s and 3 N by default, so that a
distance means the same in both: the isotropic space is the unit square, the anisotropic one a
cylinder of radius and height one. It is a cylinder, not a box, because a hand is limited in speed,
whatever its direction, and the directions of x and y are arbitrary. A velocity that is too fast
keeps its heading.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Any, Final, Self

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Le

from mmt.core.arrays import FloatArray
from mmt.core.bounds import check, check_fields, real_numbers
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.lsf import are_lsf
from mmt.texture.settings import CHANNELS, MAXIMUM_FORCE_N, MAXIMUM_SPEED_MM_S, Inputs

Maximum = Annotated[float, Ge(1e-6), Le(1e6)]
"""Largest speed or force of a space."""

_LARGEST: Final = 1e6
"""Normalised values count as no larger, so that the direction of an infinite one is defined."""

LARGEST_POWER: Final = 1e300
"""Largest power, in (m/s2)^2: that of the largest amplitude that is rendered, 1e150 m/s2. It keeps
sums over a million samples, and levels extrapolated by their slopes, finite."""

Power = Annotated[float, Ge(0), Le(LARGEST_POWER)]


@dataclass(frozen=True)
class InputSpace:
    """An input space and its limits.

    Attributes
    ----------
    name
        ``"isotropic"`` or ``"anisotropic"``.
    maximum_speed_mm_s, maximum_force_n
        Faster strokes count as this fast, stronger forces as this strong; distances are
        Euclidean after division by these two.

    Raises
    ------
    InputError
        The name is unknown, or a maximum is not positive and finite.
    """

    name: Inputs = "isotropic"
    maximum_speed_mm_s: Maximum = MAXIMUM_SPEED_MM_S
    maximum_force_n: Maximum = MAXIMUM_FORCE_N

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("maximum_speed_mm_s", "maximum_force_n"):
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def directed(self) -> bool:
        """Whether the heading counts."""
        return self.name == "anisotropic"

    @property
    def channels(self) -> tuple[str, ...]:
        """The inputs in their order, with their units."""
        return CHANNELS[self.name]

    @property
    def dimensions(self) -> int:
        """Number of inputs, d: 2 or 3."""
        return len(self.channels)

    @property
    def scale(self) -> FloatArray:
        """Divisor of each input for normalisation, shape (d,)."""
        speeds = [self.maximum_speed_mm_s] * (self.dimensions - 1)
        return np.array([*speeds, self.maximum_force_n])

    def from_motion(
        self,
        velocity_x_mm_s: npt.ArrayLike,
        velocity_y_mm_s: npt.ArrayLike,
        force_n: npt.ArrayLike,
    ) -> FloatArray:
        """Return the inputs (n, d) of a motion over the surface, each shape (n,) or scalar."""
        given = (velocity_x_mm_s, velocity_y_mm_s, force_n)
        arrays = (np.asarray(values, dtype=np.float64) for values in given)
        x, y, force = np.broadcast_arrays(*np.atleast_1d(*arrays))
        return np.stack([x, y, force] if self.directed else [np.hypot(x, y), force], axis=-1)

    def stack(self, *channels: npt.ArrayLike) -> FloatArray:
        """Return the inputs (n, d) from d channels, each shape (n,) or scalar.

        In a space of velocity and force, two channels are speed and force of a stroke along x.

        Raises
        ------
        InputError
            There are not d channels, or one is not of real numbers, or of another shape.
        """
        if self.directed and len(channels) == 2:
            channels = (channels[0], 0.0, channels[1])
        if len(channels) != self.dimensions:
            raise InputError(
                f"{len(channels)} inputs were given: an {self.name} model takes "
                f"{', '.join(self.channels)}"
            )
        arrays = list(map(np.atleast_1d, map(real_numbers, self.channels, channels)))
        if len({*map(len, arrays)} - {1}) > 1 or any(each.ndim > 1 for each in arrays):
            shapes = ", ".join(str(np.shape(each)) for each in channels)
            raise InputError(f"inputs have shapes {shapes}: each must be (n,), with one n, or ()")
        return np.stack(np.broadcast_arrays(*arrays), axis=-1)

    def speed_mm_s(self, inputs: FloatArray) -> FloatArray:
        """Return the speed (n,) of inputs (n, d)."""
        return np.hypot(inputs[:, 0], inputs[:, 1]) if self.directed else inputs[:, 0]

    def normalise(self, inputs: FloatArray) -> FloatArray:
        """Return normalised points (n, d); points outside the space are moved to its edge.

        NaN counts as zero, and so does a negative force or speed.
        """
        scaled = np.asarray(inputs, dtype=np.float64) / self.scale
        scaled[np.isnan(scaled)] = 0.0
        if not self.directed:
            return np.clip(scaled, 0.0, 1.0)
        velocity = np.clip(scaled[:, :2], -_LARGEST, _LARGEST)
        beyond = np.maximum(np.hypot(velocity[:, :1], velocity[:, 1:]), 1.0)
        return np.hstack([velocity / beyond, np.clip(scaled[:, 2:], 0.0, 1.0)])


ISOTROPIC: Final = InputSpace("isotropic")
"""Speed and force, up to 300 mm/s and 3 N."""

ANISOTROPIC: Final = InputSpace("anisotropic")
"""Velocity vector and force, up to 300 mm/s and 3 N."""


@kernel("f8(f8, f8)", inner=True)
def normalised_magnitude(value: float, per_unit: float) -> float:
    """Return a speed or force, normalised and limited to 0 ... 1; NaN counts as 0."""
    scaled = value * per_unit
    return min(scaled, 1.0) if scaled > 0.0 else 0.0


@kernel("f8(f8, f8)", inner=True)
def _bounded(value: float, per_unit: float) -> float:
    scaled = value * per_unit
    if scaled != scaled:  # noqa: PLR0124 - NaN
        return 0.0
    return max(min(scaled, _LARGEST), -_LARGEST)


@kernel("void(f8, f8, f8, f8, f8, f8[::1])", inner=True)
def normalise_into(
    first: float,
    second: float,
    third: float,
    per_speed: float,
    per_force: float,
    point: FloatArray,
) -> None:
    """Write the normalised point (d,) of one moment's d inputs, as `InputSpace.normalise` does.

    `third` is not read if d is 2. `per_speed` and `per_force` are one over the maxima.
    """
    if len(point) == 2:
        point[0] = normalised_magnitude(first, per_speed)
        point[1] = normalised_magnitude(second, per_force)
    else:
        x, y = _bounded(first, per_speed), _bounded(second, per_speed)
        square = x * x + y * y
        if square > 1.0:
            beyond = np.sqrt(square)
            x /= beyond
            y /= beyond
        point[0], point[1] = x, y
        point[2] = normalised_magnitude(third, per_force)


@dataclass(frozen=True)
class TextureSamples:
    """Fitted segments.

    Attributes
    ----------
    inputs
        Mean inputs of each segment in the units of `space`, shape (n, d).
    lsf
        Line spectral frequencies in radians, shape (n, order).
    variance
        Variance of the excitation in (m/s2)^2, shape (n,).
    power
        Mean square of the vibration in (m/s2)^2, shape (n,).
    space
        Input space.
    effective
        Effective sample size of each power, shape (n,), positive; None if it is not known. See
        `mmt.texture.autoregression.forms`.
    noise_power
        Power of the accelerometer's noise in (m/s2)^2, which every power contains; 0 if it is not
        known.
    counts
        Number of vibration samples in each segment, shape (n,), positive; None if not known.
    """

    inputs: FloatArray
    lsf: FloatArray
    variance: FloatArray
    power: FloatArray
    space: InputSpace = ISOTROPIC
    effective: FloatArray | None = None
    noise_power: float = 0.0
    counts: FloatArray | None = None

    @classmethod
    def isotropic(
        cls,
        speed_mm_s: FloatArray,
        force_n: FloatArray,
        lsf: FloatArray,
        variance: FloatArray,
        power: FloatArray,
    ) -> Self:
        """Return samples in the plane of speed and force, each of shape (n,)."""
        for name, values in (("speed_mm_s", speed_mm_s), ("force_n", force_n)):
            if np.shape(values) != (len(lsf),):
                raise InputError(f"{name} has shape {np.shape(values)}, ({len(lsf)},) needed")
        return cls(np.column_stack([speed_mm_s, force_n]), lsf, variance, power)

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def speed_mm_s(self) -> FloatArray:
        """Speed of each segment, that of its mean velocity if the heading counts; (n,)."""
        return self.space.speed_mm_s(self.inputs)

    @property
    def force_n(self) -> FloatArray:
        """Mean normal force of each segment, (n,)."""
        return self.inputs[:, -1]

    @property
    def points(self) -> FloatArray:
        """Normalised inputs, shape (n, d)."""
        return self.space.normalise(self.inputs)

    def frozen(self) -> Self:
        """Return a copy whose arrays cannot be written."""
        names = ("inputs", "lsf", "variance", "power", "effective", "counts")
        given = {name: getattr(self, name) for name in names}
        arrays: Any = {name: _read_only(a) for name, a in given.items() if a is not None}
        return replace(self, **arrays)

    def check(self) -> None:
        """Check that a model can be built from the samples.

        Raises
        ------
        InputError
            Shapes disagree, a number is not finite, beyond `LARGEST_POWER` or wrongly negative,
            or an LSF set is not ascending inside (0, pi).
        """
        lsf, inputs = real_numbers("lsf", self.lsf), real_numbers("inputs", self.inputs)
        if lsf.ndim != 2 or not 1 <= lsf.shape[1] <= LARGEST_ORDER or not len(lsf):
            raise InputError(
                f"lsf has shape {lsf.shape}: at least one sample of order 1 to 64 needed"
            )
        shape = (len(lsf), self.space.dimensions)
        if inputs.shape != shape:
            raise InputError(f"inputs has shape {inputs.shape}, {shape} needed")
        for name, values in zip(self.space.channels, inputs.T, strict=True):
            signed = name.startswith("velocity")
            _check_numbers(name, values, len(lsf), signed=signed)
        for name in ("variance", "power"):
            _check_numbers(name, getattr(self, name), len(lsf))
        for name in ("effective", "counts"):
            values = getattr(self, name)
            if values is not None:
                _check_numbers(name, values, len(lsf))
                if not (np.asarray(values) > 0.0).all():
                    raise InputError(f"{name} must be positive")
        check("noise_power", self.noise_power, Power)
        if not are_lsf(np.require(lsf, requirements=["C", "W"])):  # for compiled code
            raise InputError("lsf must ascend strictly inside (0, pi)")


def _check_numbers(name: str, values: Any, count: int, *, signed: bool = False) -> None:
    values = real_numbers(name, values)
    if values.shape != (count,):
        raise InputError(f"{name} has shape {values.shape}, ({count},) needed")
    if not (np.abs(values) <= LARGEST_POWER).all() or (not signed and (values < 0).any()):
        sign = "" if signed else " and not negative"
        raise InputError(f"{name} must be finite, at most {LARGEST_POWER:g}{sign}")


def _read_only(array: Any) -> FloatArray:
    copy = np.array(array, dtype=np.float64, order="C")
    copy.setflags(write=False)
    return copy
