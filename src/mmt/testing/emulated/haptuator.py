"""An emulated Haptuator: its coil, driven through an emulated sound card."""

from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.devices.haptuator.equaliser import RATE_HZ, ActuatorLevel, fit_equaliser, sweep
from mmt.devices.haptuator.sound import SoundHaptuator, SoundOptions
from mmt.testing.emulated.sound_card import EmulatedSoundCard

RESONANCE_HZ: Final = 60.0
DAMPING_RATIO: Final = 0.2
LEVEL_M_S2_PER_V: Final = 15.0
"""Above the resonance; all three are our choice, of the order of a small voice coil."""
_SWEEP_S: Final = 8.0
_SWEPT_HZ: Final = (20.0, 490.0)
_RINGING_S: Final = 0.5
"""After this the coil is at rest to the last digit."""


def coil_acceleration_m_s2(volts: FloatArray, rate_hz: float) -> FloatArray:
    """Return the handle's acceleration (n,) for voltages (n,), by the bilinear transform."""
    size = len(volts) + round(_RINGING_S * rate_hz)
    s = 2j * rate_hz * np.tan(np.pi * np.fft.rfftfreq(size)) / (2.0 * np.pi * RESONANCE_HZ)
    transfer = LEVEL_M_S2_PER_V * s**2 / (s**2 + 2.0 * DAMPING_RATIO * s + 1.0)
    return np.asarray(np.fft.irfft(np.fft.rfft(volts, size) * transfer, size)[: len(volts)])


def swept_level() -> ActuatorLevel:
    """Return the level that `mmt device equalise` would store for this coil."""
    volts = sweep(1.0, *_SWEPT_HZ, _SWEEP_S)
    return fit_equaliser(volts, coil_acceleration_m_s2(volts, RATE_HZ))


_HISTORY_S: Final = 10.0
_LOGGED_S: Final = 600.0


class EmulatedHaptuatorOptions(SoundOptions):
    """Options of ``virtual-haptuator-sound``."""

    log: Path | None = None
    """File to which the played voltages are written on `close`."""


class EmulatedHaptuator(SoundHaptuator):
    """The driver of the sound card, with an emulated card whose time runs while it is connected.

    With a `serial` its level is that of a sweep of the emulated coil.
    """

    OPTIONS = EmulatedHaptuatorOptions

    def __init__(self, options: EmulatedHaptuatorOptions) -> None:
        self._log = options.log
        self.card = EmulatedSoundCard(
            channels=max(2, options.channel),
            history_s=_HISTORY_S if self._log is None else _LOGGED_S,
        )
        level = None if options.serial is None else swept_level()
        super().__init__(options, self.card, level=level)

    def connect(self) -> None:
        """Open the card and start its time."""
        super().connect()
        self.card.start()

    def close(self) -> None:
        """Fade out, stop the card and write the log."""
        super().close()
        self.card.stop()
        if self._log is not None and self.card.begun_s:
            options = self._options
            volts = self.card.played(options.channel) * options.full_scale_v
            first_s = self._block_frames / options.card_rate_hz + self.card.dac_latency_s
            np.savez(
                self._log,
                volts=volts.astype(np.float32),
                rate_hz=options.card_rate_hz,
                start_s=self.card.begun_s + first_s,
            )
            self._log = None
