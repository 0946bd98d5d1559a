"""The library `sounddevice`, which is imported only where a scene asks for a sound card."""

from typing import Any

from mmt.core.errors import InputError, MmtError


def load_sounddevice() -> Any:
    """Import the library.

    Raises
    ------
    MmtError
        It is not installed, or lacks PortAudio.
    """
    try:
        import sounddevice
    except ImportError as error:
        raise MmtError(
            "the sound card needs the package 'sounddevice': pip install \"mmt-haptics[sound]\""
        ) from error
    except OSError as error:
        raise MmtError(
            f"the sound card needs PortAudio ({error}): install the system's package for it, "
            "on Debian and Ubuntu libportaudio2"
        ) from error
    return sounddevice


def find_output(library: Any, device: str | int | None, channel: int) -> int:
    """Return the number of an output that has the channel.

    A card that was plugged in after PortAudio had looked is unknown to it: where none is found,
    it looks again.

    Raises
    ------
    InputError
        There is none, or several of that name, or it has fewer channels; the message lists what
        there is.
    """
    try:
        found = library.query_devices(device, "output")
    except (ValueError, library.PortAudioError):
        _look_again(library)
        try:
            found = library.query_devices(device, "output")
        except (ValueError, library.PortAudioError) as error:
            wanted = "no default output" if device is None else f"no single output {device!r}"
            raise InputError(f"sound card: there is {wanted}; {_outputs(library)}") from error
    channels = int(found["max_output_channels"])
    if channel > channels:
        raise InputError(
            f"sound card {found['name']!r} has {channels} output channels, 'channel' is {channel}"
        )
    return int(found["index"])


def _look_again(library: Any) -> None:
    # The library has no public call for this; these two are what its author recommends.
    library._terminate()
    library._initialize()


def _outputs(library: Any) -> str:
    names = [
        f"{entry['index']} {entry['name']!r}"
        for entry in library.query_devices()
        if entry["max_output_channels"] > 0
    ]
    if not names:
        return "PortAudio sees no output at all: check the cable, and your right to use sound"
    return f"outputs are {', '.join(names)}"
