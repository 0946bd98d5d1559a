"""A Haptuator on a sound card in software, for a scene that has neither."""

from typing import Any

from mmt.devices.drivers import read_options
from mmt.devices.haptuator.sound import DRIVER, SoundHaptuator, SoundOptions
from mmt.testing.emulated.sound_card import EmulatedSoundCard


def emulated_haptuator(**options: Any) -> "EmulatedHaptuator":
    """Make the driver on an emulated card; options are those of ``haptuator-sound``.

    Raises
    ------
    InputError
        An option is not allowed.
    """
    return EmulatedHaptuator(read_options(SoundOptions, DRIVER, options))


class EmulatedHaptuator(SoundHaptuator):
    """The driver of the sound card, with a card whose time goes on while it is connected."""

    def __init__(self, options: SoundOptions) -> None:
        self.card = EmulatedSoundCard(channels=max(2, options.channel))
        super().__init__(options, self.card)

    def connect(self) -> None:
        """Open the card and let its time go on."""
        super().connect()
        self.card.start()

    def close(self) -> None:
        """Fade out and stop the card."""
        super().close()
        self.card.stop()
