"""Vibration from a texture model, block by block or sample by sample.

Awan et al., section VI: white Gaussian noise of the interpolated variance drives the filter
at the present speed and force, whose memory is carried over every change of filter. Here the
filter is a normalised lattice of unit power (`mmt.texture.autoregression.lattice`), and its output
is multiplied by the interpolated amplitude: the same spectrum, but the power is the model's at
every sample, also while speed and force change.

Stability: an interpolated filter is a convex combination of ordered LSF and hence stable, and
the lattice stays bounded for every course of stable filters, also one that changes at every
sample; see `mmt.texture.synthesis.generation`. Cost: O(order^2) for a renewal of the filter,
O(order) for a sample.
"""

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.texture.autoregression.lattice import lattice_step, lsf_to_lattice_into
from mmt.texture.autoregression.order_limit import LARGEST_ORDER
from mmt.texture.field.level_table import TABLE_SIZES, tabulated_level
from mmt.texture.field.trend import trend_at
from mmt.texture.interpolation.interpolator import SCRATCH, evaluate_into
from mmt.texture.model.inputs import normalise_into
from mmt.texture.model.kernel_parameters import (
    DIMENSIONS,
    FORCE_EXPONENT,
    LEVEL_KIND,
    MODEL_ORDER,
    PER_FORCE,
    PER_SPEED,
    SPEED_EXPONENT,
)
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.generation import (
    COMPLEMENT,
    LARGEST_AMPLITUDE,
    ORDER,
    PAST,
    REFLECTION,
    WANTED,
    Generator,
    scaled,
)

_COUNTER = SCRATCH  # scratch: that of the evaluator, samples, where it found the point,
_HINT = _COUNTER + 1  # then point, level and LSF, work
_POINT = _HINT + 1
_VALUES = _POINT + 3
_WORK = _VALUES + 1 + LARGEST_ORDER


class Synthesizer:
    """Render vibration; the same seed gives the same samples whatever the block size.

    Parameters
    ----------
    model
        Model to render, None for silence. Assigning `model` later keeps the filter's memory.
    seed
        Seed of the excitation.
    renewal_samples
        Number of samples between updates of the filter to speed and force.
    limit_m_s2
        Bound on the output.
    """

    def __init__(
        self,
        model: TextureModel | None = None,
        *,
        seed: int = 0,
        renewal_samples: int = 1,
        limit_m_s2: float = 60.0,
    ) -> None:
        self.model = model
        self._renewal = renewal_samples
        self._generator = Generator(seed=seed, limit_m_s2=limit_m_s2)
        self._scratch = np.zeros(_WORK + 5 * LARGEST_ORDER)

    @property
    def directed(self) -> bool:
        """Whether the model is one of velocity, not of speed."""
        return self.model is not None and self.model.space.directed

    def render(self, *inputs: FloatArray) -> FloatArray:
        """Return the next n samples of vibration in m/s2.

        Parameters
        ----------
        *inputs
            The hand's motion at each sample, in the model's input space: speed and normal
            force, or velocity x, y and normal force, where speed and normal force alone are a
            stroke along x; each of shape (n,), float64, a column of an array too. Values beyond
            the space are limited to its end; a negative speed or force, and NaN, count as zero.

        Raises
        ------
        InputError
            There are not as many inputs as the model's space has, or not all are float64 and
            of the same length.
        """
        count = len(inputs[0])
        model, generator = self.model, self._generator
        if model is None:
            generator.use(None)
            return generator.generate(count)
        if len(inputs) == 2 and model.dimensions == 3:
            inputs = (inputs[0], np.zeros(count), inputs[1])
        if len(inputs) != model.dimensions:
            raise InputError(
                f"{len(inputs)} inputs were given: the model takes "
                f"{', '.join(model.space.channels)}"
            )
        if generator.rate_hz != model.rate_hz:
            generator.set_rate(model.rate_hz)
        by, output = model.interpolant, np.empty(count)
        try:
            is_rendered = _render(
                by.evaluator.address,
                by.rows,
                by.links,
                by.tail,
                model.kernel_parameters,
                inputs[0],
                inputs[1],
                inputs[-1],
                self._renewal,
                generator.limit_m_s2,
                generator.release,
                generator.draw(count),
                generator.state,
                self._scratch,
                output,
            )
        except TypeError as error:
            raise InputError(_unfit(inputs)) from error
        if not is_rendered:
            raise InputError(_unfit(inputs))
        return output

    def reset(self) -> None:
        """Silence the output at once; the excitation goes on."""
        self._generator.reset()


def _unfit(inputs: tuple[FloatArray, ...]) -> str:
    given = ", ".join(f"{np.shape(v)} {np.asarray(v).dtype}" for v in inputs)
    return f"inputs are arrays of {given}: each must be (n,) float64, with the same n"


@kernel("f8(f8, i8, f8[::1])")
def _amplitude(level: float, level_kind: int, complement: FloatArray) -> float:
    """Return the root of the output's power."""
    if level_kind == 2:
        return level
    amplitude = np.sqrt(level)
    if level_kind == 0:
        for cosine in complement:
            amplitude /= cosine
    return float(min(amplitude, LARGEST_AMPLITUDE))


@kernel(
    "b1(i8, f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[:], f8[:], f8[:], i8, f8, f8,"
    " f8[::1], f8[::1], f8[::1], f8[::1])"
)
def _render(
    evaluator: int,
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    parameters: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    renewal: int,
    limit: float,
    release: float,
    noise: FloatArray,
    state: FloatArray,
    scratch: FloatArray,
    output: FloatArray,
) -> bool:
    """Write vibration (n,); false, and nothing, where the inputs are not all of shape (n,)."""
    count = len(output)
    if len(first) != count or len(second) != count or len(third) != count:
        return False
    level_kind, order = int(parameters[LEVEL_KIND]), int(parameters[MODEL_ORDER])
    per_speed, per_force = parameters[PER_SPEED], parameters[PER_FORCE]
    speed_exponent = parameters[SPEED_EXPONENT]
    tabulated = parameters[TABLE_SIZES] > 0.0
    point = scratch[_POINT : _POINT + int(parameters[DIMENSIONS])]
    values, work = scratch[_VALUES : _VALUES + 1 + order], scratch[_WORK:]
    lsf = values[1:]
    reflection = state[REFLECTION : REFLECTION + order]
    complement = state[COMPLEMENT : COMPLEMENT + order]
    past = state[PAST:]
    for index in range(count):
        if int(scratch[_COUNTER]) % renewal == 0:
            now = first[index], second[index], third[index]
            normalise_into(now[0], now[1], now[2], per_speed, per_force, point)
            hint = int(scratch[_HINT])
            hint = evaluate_into(evaluator, rows, links, tail, hint, point, values, scratch)
            scratch[_HINT] = hint
            lsf_to_lattice_into(lsf, reflection, complement, work)
            state[ORDER] = order
            level = values[0]
            if tabulated:
                across = point[1] if len(point) == 3 else 0.0
                level = tabulated_level(parameters, point[0], across, point[len(point) - 1])
            elif speed_exponent > 0.0:
                level *= trend_at(speed_exponent, parameters[FORCE_EXPONENT], point)
            state[WANTED] = _amplitude(level, level_kind, complement)
        scratch[_COUNTER] += 1.0
        value = lattice_step(reflection, complement, past, int(state[ORDER]), noise[index])
        output[index] = scaled(state, value, release, limit)
    return True
