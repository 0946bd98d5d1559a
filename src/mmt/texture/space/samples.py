"""Fitted segments: what a texture model is built from."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, Final, Self

import numpy as np
from annotated_types import Ge, Le

from mmt.core.arrays import FloatArray
from mmt.core.bounds import check, real_numbers
from mmt.core.errors import InputError
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.space.inputs import ISOTROPIC, InputSpace

LARGEST_POWER: Final = 1e300
"""Largest power, in (m/s2)^2: that of the largest amplitude that is rendered, 1e150 m/s2. It keeps
sums over a million samples, and levels extrapolated by their slopes, finite."""

Power = Annotated[float, Ge(0), Le(LARGEST_POWER)]


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
        `mmt.texture.autoregression.spectra`.
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
        inside = np.isfinite(lsf).all() and (lsf > 0).all() and (lsf < np.pi).all()
        if not inside or (np.diff(lsf, axis=1) <= 0).any():
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
