"""An emulated Haptuator on an emulated sound card, for a scene that has neither."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.devices.drivers import read_options
from mmt.devices.haptuator.equaliser import ActuatorLevel
from mmt.devices.haptuator.sound import DRIVER, SoundHaptuator, SoundOptions
from mmt.testing.emulated.coil import swept_level
from mmt.testing.emulated.sound_card import EmulatedSoundCard

_HISTORY_S: Final = 10.0
_LOGGED_S: Final = 600.0


def emulated_haptuator(log: str | None = None, **options: Any) -> "EmulatedHaptuator":
    """Make the driver on an emulated card; options are those of ``haptuator-sound``.

    With a `serial` its level is that of a sweep of the emulated coil (`mmt.testing.emulated.coil`).
    `log` names a file to which the played voltages are written on `close`.

    Raises
    ------
    InputError
        An option is not allowed.
    """
    checked = read_options(SoundOptions, DRIVER, options)
    level = None if checked.serial is None else swept_level()
    return EmulatedHaptuator(checked, level, None if log is None else Path(log))


class EmulatedHaptuator(SoundHaptuator):
    """The driver of the sound card, with an emulated card whose time runs while it is connected."""

    def __init__(
        self, options: SoundOptions, level: ActuatorLevel | None = None, log: Path | None = None
    ) -> None:
        self.card = EmulatedSoundCard(
            channels=max(2, options.channel), history_s=_HISTORY_S if log is None else _LOGGED_S
        )
        self._log = log
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
