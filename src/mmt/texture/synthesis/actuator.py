"""What an actuator makes of a texture: how much of its power reaches the skin."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.texture.model.texture_model import TextureModel

FREQUENCIES_HZ: Final = np.arange(10.0, 500.0, 5.0)
"""Where a response is told and a texture's power is summed."""
_MOST_STROKES: Final = 64


class ActuatorResponse(NamedTuple):
    """The acceleration at the handle over the one that is asked for, by frequency."""

    gain: FloatArray
    """Magnitude at `FREQUENCIES_HZ`, shape (98,)."""
    low_hz: float
    """Below this the actuator is not driven."""

    def as_dict(self) -> dict[str, Any]:
        """Return it for a recording."""
        return {"gain": np.round(self.gain, 4).tolist(), "low_hz": self.low_hz}

    @classmethod
    def from_dict(cls, found: Mapping[str, Any]) -> "ActuatorResponse | None":
        """Return what `as_dict` gave, None for anything else."""
        gain, low_hz = found.get("gain"), found.get("low_hz")
        if not isinstance(gain, list) or not isinstance(low_hz, int | float):
            return None
        numbers = np.array(gain, dtype=np.float64)
        fits = numbers.shape == FREQUENCIES_HZ.shape and np.isfinite(numbers).all()
        return cls(numbers, float(low_hz)) if fits else None

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
        """Return the share of a model's power that reaches the skin, over the strokes it is of."""
        inputs = model.samples.inputs[:: max(1, len(model.samples) // _MOST_STROKES)]
        density = model.spectrum(*inputs.T, frequencies_hz=FREQUENCIES_HZ)
        return float(np.mean(self.played_share(density)))


def level_at_skin_db(share: float) -> float:
    """Return by how much what is felt is louder than the texture, dB."""
    return float(10.0 * np.log10(max(share, 1e-10)))


def skin_sentence(share: float, low_hz: float) -> str:
    """Return what a person wants to know of the share that reaches the skin."""
    return (
        f"this actuator plays {100.0 * share:.0f} % of this texture's power "
        f"({level_at_skin_db(share):+.1f} dB at the skin): it is not driven below {low_hz:.0f} Hz"
    )
