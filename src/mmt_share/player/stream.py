"""The sound of one page: samples at its sound card's rate, as far ahead as the page requests.

The page sends how many samples it has played and how many it wants to have beyond these. So the
sound card's clock alone paces the stream: nothing drifts, and the page can change the length of
its buffer, which is delay, from one request to the next.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.rendering import close, open_textures, render, touch
from mmt.rendering.rate import RateConverter
from mmt.texture.model.texture_model import TextureModel
from mmt_share.player.messages import PlayRequest
from mmt_share.player.motion import PointerMotion

LONGEST_LEAD_S: Final = 0.5
SLOWEST_HZ, FASTEST_HZ = 8000, 192_000
"""Sampling rates of sound cards."""
ESTIMATE_HZ: Final = 200.0
"""A new estimate for about every request; paper B has 100 a second."""
_FASTER: Final = 1.05
"""How much faster than this machine's clock a sound card's may be."""


@dataclass(frozen=True, eq=False)
class Block:
    """The next samples.

    Attributes
    ----------
    sound_m_s2
        At the sound card's rate, shape (n,).
    vibration_m_s2
        The same before its conversion, at `Stream.render_hz`, shape (m,).
    """

    sound_m_s2: FloatArray
    vibration_m_s2: FloatArray


class Stream:
    """Render the vibration under a pointer.

    Parameters
    ----------
    models
        The textures. The fastest one's rate is rendered at; at rates of 1 kHz nothing is
        converted but to the sound card's.
    rate_hz
        Sampling rate of the sound card.
    seed
        Seed of the excitation.
    clock
        Monotonic time (s).

    Raises
    ------
    InputError
        The rate is out of the range of sound cards.
    """

    def __init__(
        self,
        models: Sequence[TextureModel],
        rate_hz: int,
        *,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
            raise InputError(
                f"a sound card's rate is {rate_hz} Hz: allowed are {SLOWEST_HZ} to {FASTEST_HZ}"
            )
        self.rate_hz = rate_hz
        self.render_hz = max(model.rate_hz for model in models)
        self.sent = 0
        """Samples since the stream began."""
        self._textures = open_textures(
            models, output_hz=self.render_hz, estimate_hz=ESTIMATE_HZ, seed=seed
        )
        self._converter = RateConverter(self.render_hz, rate_hz)
        self._clock = clock
        self._then_s = clock()
        self._credit = LONGEST_LEAD_S * rate_hz

    @property
    def delay_s(self) -> float:
        """Delay of a sample by the conversion of sampling rates."""
        return self._textures.output.delay_s + self._converter.delay_s

    def next(self, request: PlayRequest, motion: PointerMotion, texture: int | None) -> Block:
        """Render the samples that the page lacks, with the pointer's present motion.

        At most as many as a sound card can have played in the time since the stream began.
        """
        x_mm_s, y_mm_s = motion.velocity_mm_s
        touch(self._textures, texture, x_mm_s, y_mm_s, motion.force_n)
        longest = int(LONGEST_LEAD_S * self.rate_hz)
        lacking = min(request.played, self.sent) + min(request.lead, longest) - self.sent
        count = max(0, min(lacking, int(self._earned())))
        vibration = render(self._textures, self._converter.needed(count))
        sound = self._converter.convert(vibration, count) if count else np.zeros(0)
        self.sent += count
        self._credit -= count
        return Block(sound, vibration)

    def use(self, models: Sequence[TextureModel]) -> None:
        """Fade to other states of the models, as many and of the same rates as before."""
        self._textures.use(models)

    def close(self) -> None:
        """End rendering."""
        close(self._textures)

    def _earned(self) -> float:
        now_s = self._clock()
        earned = self._credit + _FASTER * self.rate_hz * (now_s - self._then_s)
        self._then_s = now_s
        self._credit = min(earned, 2.0 * LONGEST_LEAD_S * self.rate_hz)
        return self._credit
