"""From one state of a model that grows to the next, without a step.

While a surface is touched its model is replaced once a second, by one that differs by some tenths
of a dB. The new state is faded in: the line spectral frequencies and the power at the present
speed and force are a mean of both states', by shares that go linearly from one to the other. A
convex combination of ordered LSF is ordered: each filter of a fade is stable. So two hands of
which one learns each state a little later feel nearly the same.
"""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.texture.autoregression.lsf import lsf_inverse_gain
from mmt.texture.autoregression.order_limit import LARGEST_ORDER
from mmt.texture.autoregression.spectra import lsf_spectrum
from mmt.texture.autoregression.split import separate
from mmt.texture.model.texture_model import TextureModel

State = TypeVar("State")


class UpdateFade(Generic[State]):
    """Which states of something that grows are in use, and the share of the newer one.

    A state is faded in over as many steps as the one before was in use: what is replaced quickly
    is left quickly. A state that comes in mid-fade ends that fade at once.

    Parameters
    ----------
    first
        The first state.
    longest
        Steps of the longest fade; 0 changes at once.
    """

    def __init__(self, first: State, longest: int) -> None:
        self.now = first
        self.before: State | None = None
        """What is faded out, None where nothing is."""
        self.passed, self.length = 0, 0
        """Steps since the newer state came, and those of its fade."""
        self._longest = longest

    @property
    def share(self) -> float:
        """Share of the newer state, 0 to 1."""
        return min(1.0, self.passed / self.length) if self.length else 1.0

    def use(self, state: State, *, at_once: bool = False) -> None:
        """Go over to a newer state, by a fade unless it is to be at once."""
        self.length = 0 if at_once else min(self._longest, self.passed)
        self.before = self.now if self.length else None
        self.now, self.passed = state, 0

    def advance(self, steps: int) -> None:
        """Let so many steps pass."""
        self.passed += steps
        if self.passed >= self.length:
            self.finish()

    def finish(self) -> None:
        """End the fade."""
        self.before, self.length = None, 0


@dataclass(frozen=True, eq=False)
class MixedModel:
    """The mean of two models of one order, rate and number of inputs, in mid-fade.

    Attributes
    ----------
    before, now
        The models.
    share
        That of `now`, 0 to 1.
    """

    before: TextureModel
    now: TextureModel
    share: float

    @property
    def order(self) -> int:
        """The order of the filters."""
        return self.now.order

    def at(self, *inputs: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return LSF (k, order) and variance (k,) at inputs as of `TextureModel.at`."""
        (old, old_variance), (new, new_variance) = self.before.at(*inputs), self.now.at(*inputs)
        lsf = (1.0 - self.share) * old + self.share * new
        for row in lsf:
            separate(row)  # rounding may have let frequencies meet
        power = (1.0 - self.share) * _power(old, old_variance)
        power += self.share * _power(new, new_variance)
        return lsf, power * _inverse_gain(lsf)

    def spectrum(self, *inputs: npt.ArrayLike, frequencies_hz: FloatArray) -> FloatArray:
        """Return the one-sided density (k, f), as `TextureModel.spectrum`."""
        return lsf_spectrum(*self.at(*inputs), frequencies_hz, self.now.rate_hz)


def can_be_mixed(before: TextureModel | None, now: TextureModel | None) -> bool:
    """Return whether two models have filters between them."""
    if before is None or now is None:
        return False
    alike = before.order, before.rate_hz, before.dimensions
    return alike == (now.order, now.rate_hz, now.dimensions)


def _power(lsf: FloatArray, variance: FloatArray) -> FloatArray:
    gain = _inverse_gain(lsf)
    return np.divide(variance, gain, out=np.zeros_like(gain), where=gain > 0.0)


def _inverse_gain(lsf: FloatArray) -> FloatArray:
    """Return the variance of the excitation at an output of power one, (k,)."""
    work = np.empty(2 * LARGEST_ORDER)
    return np.array([lsf_inverse_gain(row, work) for row in lsf])
