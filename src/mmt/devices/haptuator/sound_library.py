"""The library of sound cards: whether it is installed, and the outputs that it finds."""

from typing import Any, Final

from mmt.core.errors import MmtError
from mmt.core.extras import require
from mmt.devices.discovery import FoundPort


def load_sounddevice() -> Any:
    """Import the library.

    Raises
    ------
    InputError
        The library is not installed.
    MmtError
        PortAudio is missing.
    """
    require("sounddevice")
    try:
        import sounddevice
    except OSError as error:
        raise MmtError(
            f"the sound card needs PortAudio ({error}): install the system's package for it, "
            "on Debian and Ubuntu libportaudio2"
        ) from error
    return sounddevice


def missing() -> str:
    """Return what this machine lacks for the driver, with what to do; empty if nothing."""
    try:
        load_sounddevice()
    except MmtError as error:
        return str(error)
    return ""


def find_sound_outputs() -> list[FoundPort]:
    """Return the sound cards' outputs, by the number and name that a scene can give.

    Raises
    ------
    MmtError
        The library or PortAudio is missing.
    """
    return [
        FoundPort(str(entry["index"]), f"{entry['name']}, {channels} channels", "", "")
        for entry in load_sounddevice().query_devices()
        if (channels := entry["max_output_channels"]) > 0
    ]


FINDERS: Final = {"sound outputs": find_sound_outputs}
