"""Vibration from a texture model, block by block or sample by sample.

Awan et al., section VI: white Gaussian noise of the interpolated variance drives the filter
at the present speed and force, whose memory is carried over every change of filter. Here the
filter is a lattice of unit power, which stays bounded (`mmt.texture.synthesis.generation`), and its
output is multiplied by the interpolated amplitude: the same spectrum, but the power is the model's
at every sample, also while speed and force change.

Cost: O(order^2) for a renewal of the filter, O(order) for a sample.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.bounds import check, real_numbers
from mmt.core.compiled import kernel
from mmt.core.errors import InputError
from mmt.texture.autoregression import LARGEST_ORDER
from mmt.texture.autoregression.lsf import lattice_step, lsf_to_lattice_into
from mmt.texture.interpolation.interpolant import (
    DIMENSIONS,
    MODEL_ORDER,
    PER_FORCE,
    PER_SPEED,
    SCRATCH,
    TABLE_SIZES,
    interpolate_into,
    tabulated_level,
)
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import normalise_into
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

_COUNTER = SCRATCH  # the scratch holds that of the interpolation, a sample counter, the
_HINT = _COUNTER + 1  # simplex found last, the point, level and LSF, and work
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
        Number of samples between updates of the filter to speed and force, 1 or more.
    limit_m_s2
        Bound on the output, above 0; infinite for none.

    Raises
    ------
    InputError
        A number is not in its range.
    """

    def __init__(
        self,
        model: TextureModel | None = None,
        *,
        seed: int = 0,
        renewal_samples: int = 1,
        limit_m_s2: float = 60.0,
    ) -> None:
        check("model", model, TextureModel | None)
        check("renewal_samples", renewal_samples, Annotated[int, Ge(1)])
        self.model = model
        self._renewal = renewal_samples
        self._generator = Generator(seed=seed, limit_m_s2=limit_m_s2)
        self._scratch = np.zeros(_WORK + 5 * LARGEST_ORDER)
        self._transient = np.zeros(0)

    @property
    def directed(self) -> bool:
        """Whether the model takes a velocity vector, not a speed."""
        return self.model is not None and self.model.space.directed

    def render(
        self, *inputs: FloatArray | Sequence[float], excitation: FloatArray | None = None
    ) -> FloatArray:
        """Return the next n samples of vibration in m/s2.

        Parameters
        ----------
        *inputs
            The hand's motion at each sample, of shape (n,), fastest as float64: speed and
            normal force, or velocity x, y and normal force (two inputs are then speed and force of
            a stroke along x). Values outside the model's input space are limited to it; a negative
            speed or force, and NaN, count as zero.
        excitation
            White samples of variance one, (n,), in place of the synthesizer's own, which do not
            advance. If these are the first samples, the filter starts at rest: two renderers of one
            model then give the same samples for one excitation, whatever their seeds.

        Raises
        ------
        InputError
            There are not as many inputs as the model's space has, not all are real numbers and of
            the same length, or the excitation is not as long or not finite.
        """
        model, generator = self.model, self._generator
        if not inputs or np.ndim(inputs[0]) != 1:
            raise InputError(_unfit(inputs))
        if model is None:
            generator.set_filter(None)
            return generator.generate(len(inputs[0]))
        if len(inputs) == 2 and model.dimensions == 3:
            inputs = (inputs[0], np.zeros(len(inputs[0])), inputs[1])
        if len(inputs) != model.dimensions:
            raise InputError(
                f"{len(inputs)} inputs were given: the model takes "
                f"{', '.join(model.space.channels)}"
            )
        if generator.rate_hz != model.rate_hz:
            generator.set_rate(model.rate_hz)
        count = len(inputs[0])
        noise = generator.excitation(count, excitation)
        output = np.empty(count)
        try:
            is_rendered = self._render_into(output, model, inputs, noise)
        except (TypeError, ValueError):  # so that a tick, whose inputs fit, need not look at them
            rows = tuple(map(_as_rows, inputs))
            is_rendered = self._render_into(output, model, rows, noise)
        if not is_rendered:
            raise InputError(_unfit(inputs))
        if len(self._transient):
            begun = self._transient[:count]
            output[: len(begun)] += begun
            self._transient = self._transient[count:]
            np.clip(output, -generator.limit_m_s2, generator.limit_m_s2, out=output)
        return output

    def _render_into(
        self, output: FloatArray, model: TextureModel, inputs: tuple[Any, ...], noise: FloatArray
    ) -> bool:
        generator = self._generator
        return _render(
            *model.interpolant,
            model.kernel_parameters,
            inputs[0],
            inputs[1],
            inputs[-1],
            self._renewal,
            generator.limit_m_s2,
            generator.release,
            noise,
            generator.state,
            self._scratch,
            output,
        )

    def touch_down(self, approach_speed_mm_s: float) -> None:
        """Add the transient of a touch-down to the samples that follow, if the model has one.

        Parameters
        ----------
        approach_speed_mm_s
            Speed into the surface just before the contact; nothing is added unless it is positive.
        """
        transient = None if self.model is None else self.model.touch_down
        if transient is None:
            return
        added, left = transient.response(approach_speed_mm_s), self._transient
        if len(left) > len(added):
            added, left = left.copy(), added
        added[: len(left)] += left
        self._transient = added

    def reset(self) -> None:
        """Silence the output at once; the excitation goes on."""
        self._transient = np.zeros(0)
        self._generator.reset()


def _as_rows(values: FloatArray | Sequence[float]) -> FloatArray:
    """Return a copy of an input as the kernel takes it."""
    array = real_numbers("an input", values).copy()
    if array.ndim != 1:
        raise InputError(_unfit((values,)))
    return array


def _unfit(inputs: Sequence[FloatArray | Sequence[float]]) -> str:
    given = ", ".join(f"{np.shape(v)} {np.asarray(v).dtype}" for v in inputs) or "none"
    return f"inputs are arrays of {given}: each must be (n,) numbers, with the same n"


@kernel(
    "f8(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8, f8, f8, f8[::1], f8[::1], f8[::1],"
    " f8[::1])",
    inner=True,
)
def _filter_into(
    rows: FloatArray,
    links: IntArray,
    tail: FloatArray,
    parameters: FloatArray,
    first: float,
    second: float,
    third: float,
    values: FloatArray,
    reflection: FloatArray,
    complement: FloatArray,
    scratch: FloatArray,
) -> float:
    """Write a model's level and LSF, and its lattice, at one motion; return the amplitude."""
    point = scratch[_POINT : _POINT + int(parameters[DIMENSIONS])]
    normalise_into(first, second, third, parameters[PER_SPEED], parameters[PER_FORCE], point)
    hint = int(scratch[_HINT])
    scratch[_HINT] = interpolate_into(rows, links, tail, hint, point, values, scratch)
    lsf_to_lattice_into(values[1:], reflection, complement, scratch[_WORK:])
    if parameters[TABLE_SIZES] > 0.0:
        across = point[1] if len(point) == 3 else 0.0
        power = tabulated_level(parameters, point[0], across, point[len(point) - 1])
        return min(math.sqrt(power), LARGEST_AMPLITUDE)
    amplitude = math.sqrt(values[0])
    for cosine in complement:
        amplitude /= cosine
    return min(amplitude, LARGEST_AMPLITUDE)


@kernel(
    "b1(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[::1], f8[:], f8[:], f8[:], i8, f8, f8, f8[::1],"
    " f8[::1], f8[::1], f8[::1])"
)
def _render(
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
    """Write vibration (n,); return False, and write nothing, if an input is not of shape (n,)."""
    count = len(output)
    if len(first) != count or len(second) != count or len(third) != count:
        return False
    order = int(parameters[MODEL_ORDER])
    values = scratch[_VALUES : _VALUES + 1 + order]
    reflection = state[REFLECTION : REFLECTION + order]
    complement = state[COMPLEMENT : COMPLEMENT + order]
    past = state[PAST:]
    for index in range(count):
        if int(scratch[_COUNTER]) % renewal == 0:
            x, y, z = first[index], second[index], third[index]
            state[WANTED] = _filter_into(
                *(rows, links, tail, parameters, x, y, z),
                *(values, reflection, complement, scratch),
            )
            state[ORDER] = order
        scratch[_COUNTER] += 1.0
        value = lattice_step(reflection, complement, past, int(state[ORDER]), noise[index])
        output[index] = scaled(state, value, release, limit)
    return True
