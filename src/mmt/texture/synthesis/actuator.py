"""Response of an actuator, and the share of a texture's power that reaches the skin."""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple, TypeGuard

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.texture.model.texture_model import TextureModel

FREQUENCIES_HZ: Final = np.arange(10.0, 500.0, 5.0)
"""Frequencies at which a response is given and a texture's power is summed."""
_MOST_STROKES: Final = 64
_LARGEST: Final = 1e6
"""Largest gain, and largest frequency in Hz, of an actuator."""


class ActuatorResponse(NamedTuple):
    """Ratio of the acceleration at the handle to the wanted one, by frequency."""

    gain: FloatArray
    """Magnitude at `FREQUENCIES_HZ`, shape (98,)."""
    low_hz: float
    """Below this the actuator is not driven."""

    def as_dict(self) -> dict[str, Any]:
        """Return the response for a recording."""
        return {"gain": np.round(self.gain, 4).tolist(), "low_hz": self.low_hz}

    @classmethod
    def from_dict(cls, found: Mapping[str, Any]) -> "ActuatorResponse":
        """Return the response from the result of `as_dict`.

        Raises
        ------
        InputError
            The mapping is no such result.
        """
        gain, low_hz = found.get("gain"), found.get("low_hz")
        count = len(FREQUENCIES_HZ)
        if not isinstance(gain, list) or len(gain) != count or not all(map(_is_size, gain)):
            raise InputError(f"gain must be a list of {count} numbers from 0 to {_LARGEST:g}")
        if not _is_size(low_hz):
            raise InputError(f"low_hz must be a number from 0 to {_LARGEST:g}")
        return cls(np.array(gain, dtype=np.float64), float(low_hz))

    def played_share(self, density: FloatArray) -> FloatArray:
        """Return the share of the power that reaches the skin, (k,).

        Parameters
        ----------
        density
            Power spectral densities (k, 98) at `FREQUENCIES_HZ`.
        """
        power = np.maximum(density.sum(axis=1), 1e-300)
        return np.asarray((density * self.gain**2).sum(axis=1) / power)

    def played_of(self, model: TextureModel) -> float:
        """Return the share of a model's power that reaches the skin: mean over its samples."""
        inputs = model.samples.inputs[:: math.ceil(len(model.samples) / _MOST_STROKES)]
        density = model.spectrum(*inputs.T, frequencies_hz=FREQUENCIES_HZ)
        return float(np.mean(self.played_share(density)))


def _is_size(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and 0.0 <= value <= _LARGEST


def skin_sentence(share: float, low_hz: float) -> str:
    """Return a sentence on the share of the power, and the level, that reaches the skin."""
    level_db = 10.0 * math.log10(max(share, 1e-10))
    return (
        f"this actuator plays {100.0 * share:.0f} % of this texture's power "
        f"({level_db:+.1f} dB at the skin): it is not driven below {low_hz:.0f} Hz"
    )
