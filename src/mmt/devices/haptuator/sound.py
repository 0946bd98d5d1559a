"""A Haptuator behind an amplifier at a sound card's output."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.core.extras import require
from mmt.devices.discovery import FoundPort, lacking
from mmt.devices.haptuator.card_buffer import CardBuffer
from mmt.devices.haptuator.driver import SILENCE_NS, HaptuatorDriver
from mmt.devices.haptuator.equaliser import ActuatorLevel
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.devices.leader_reports import ActuatorStatistics


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


missing = lacking(load_sounddevice)


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


def find_output(library: Any, device: str | int | None, channel: int) -> int:
    """Return the number of an output that has the channel.

    PortAudio does not know a card that was plugged in after its last search: if no output is
    found, it searches again.

    Raises
    ------
    InputError
        There is no such output, there are several, or it has fewer channels; the message lists
        the outputs.
    """
    try:
        found = library.query_devices(device, "output")
    except (ValueError, library.PortAudioError):
        _restart_library(library)
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


def _restart_library(library: Any) -> None:
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


_FADE_PATIENCE_S: Final = 0.1
_LONGEST_AHEAD_S: Final = 5.0


class SoundOptions(HaptuatorOptions):
    """Options of ``haptuator-sound``."""

    device: str | int | None = None
    """Output by part of its name or by number; None for the system's default."""
    channel: int = Field(default=1, ge=1, le=64)
    """Output that the amplifier is plugged into, counted from 1; the others are silent."""
    card_rate_hz: int = Field(default=48_000, ge=8000, le=192_000)
    block_ms: float = Field(default=2.0, ge=0.5, le=50)
    """Length of the blocks that the card asks for."""
    buffer_ms: float = Field(default=4.0, ge=1, le=200)
    """How late a sample may be written."""


@dataclass(frozen=True, slots=True)
class SoundStatistics(ActuatorStatistics):
    """Counts and levels, and those of the card."""

    underruns: int
    """How often samples came too late for the card."""
    slips: int
    """How often the read position jumped to be in time again."""
    card_underflows: int
    """How often the card's own buffer ran dry, as PortAudio reports it."""
    limited_frames: int
    """Interpolated frames that were beyond the limit and were cut."""
    drift_ppm: float
    """How much faster the session's clock runs than the card's."""
    latency_ms: float | None
    """Running mean of the time from `write` to the converter; None before the first block."""


class SoundHaptuator(HaptuatorDriver):
    """A `VibrationActuator` at a sound card.

    The card's thread takes blocks from a `CardBuffer` that `write` fills. Counts continue after a
    reconnection.

    Parameters
    ----------
    options
        See `SoundOptions`.
    library
        The module `sounddevice` or an emulated card in its place; None imports it.
    clock_ns
        Monotonic clock.
    level
        Level in place of the one that the options name.

    Raises
    ------
    InputError
        sounddevice is not installed.
    """

    OPTIONS = SoundOptions

    def __init__(
        self,
        options: SoundOptions,
        library: Any = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        level: ActuatorLevel | None = None,
    ) -> None:
        if library is None:
            require("sounddevice")
        super().__init__(options, float(options.card_rate_hz), level)
        self.name = f"sound card {'(default)' if options.device is None else options.device}"
        self._options = options
        self._library = library
        self._clock_ns = clock_ns
        self._block_frames = max(1, round(options.block_ms * options.card_rate_hz / 1000.0))
        self._buffer = self._new_buffer()
        self._stream: Any = None
        self._ended = False
        self._called_ns = 0
        self._card_underflows = 0
        self._card_latency_s = 0.0

    def set_rate(self, rate_hz: float) -> None:
        """Take the rate of the samples; see `RateFollowing`."""
        super().set_rate(rate_hz)
        self._buffer = self._new_buffer()

    def connect(self) -> None:
        """Open the output; silence is played until the first samples have come.

        Raises
        ------
        InputError
            There is no such output, or it has too few channels.
        MmtError
            The library is missing, or the output does not open.
        """
        self.close()
        if self._library is None:
            self._library = load_sounddevice()
        library, options = self._library, self._options
        device = find_output(library, options.device, options.channel)
        previous = self._buffer
        self._buffer = self._new_buffer()
        self._buffer.follower = previous.follower
        self._buffer.underruns, self._buffer.slips = previous.underruns, previous.slips
        self._drive.reset_filters()
        self._ended = False
        try:
            self._stream = library.OutputStream(
                samplerate=options.card_rate_hz,
                blocksize=self._block_frames,
                device=device,
                channels=options.channel,
                dtype="float32",
                latency="low",
                callback=self._fill,
                finished_callback=self._on_finished,
            )
            self._card_latency_s = float(self._stream.latency)
            self._stream.start()
            self._called_ns = self._clock_ns()
        except library.PortAudioError as error:
            self._release()
            _restart_library(library)  # it lists a card that was unplugged, perhaps plugged in anew
            raise MmtError(
                f"{self.name} cannot be opened at {options.card_rate_hz} Hz ({error}): check that "
                "it is plugged in, that no other program holds it, and 'card_rate_hz'"
            ) from error

    def _check(self) -> None:
        """Raise `DeviceLost` if the card is closed or asks for no more blocks."""
        if self._stream is None:
            raise DeviceLost(f"{self.name} is closed: connect it again")
        if self._ended or self._clock_ns() - self._called_ns > SILENCE_NS:
            raise DeviceLost(
                f"{self.name} asks for no more sound: check its cable, and that the system has not "
                "switched it off"
            )

    def _play(self, volts: list[float]) -> None:
        self._buffer.write(volts)

    def close(self) -> None:
        """Fade out and release the card; calling it twice is harmless."""
        if self._stream is None:
            return
        if not self._ended:
            self._buffer.mute()
            give_up = time.monotonic() + _FADE_PATIENCE_S
            while not self._buffer.silent and time.monotonic() < give_up:
                time.sleep(0.001)
        self._release()

    @property
    def statistics(self) -> SoundStatistics:
        """Counts and levels since the driver was made."""
        puller = self._buffer
        return SoundStatistics(
            **asdict(self._drive.statistics),
            underruns=puller.underruns,
            slips=puller.slips,
            card_underflows=self._card_underflows,
            limited_frames=self._guard.limited,
            drift_ppm=round(1e6 * puller.follower.drift, 1),
            latency_ms=self._latency_ms,
        )

    def _new_buffer(self) -> CardBuffer:
        options = self._options
        return CardBuffer(
            self._rate_hz, float(options.card_rate_hz), self._block_frames, options.buffer_ms
        )

    def _release(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            with contextlib.suppress(self._library.PortAudioError):  # the card may be gone
                stream.abort()
            with contextlib.suppress(self._library.PortAudioError):
                stream.close()

    def _fill(self, block: npt.NDArray[np.float32], frames: int, times: Any, status: Any) -> None:
        """Fill a block (frames, channels) for the card, in the card's own thread."""
        if status.output_underflow:
            self._card_underflows += 1
        self._called_ns = self._clock_ns()
        volts = self._buffer.read(frames)
        self._guard.apply(volts)
        block.fill(0.0)
        block[:, -1] = volts / self._options.full_scale_v
        if not self._buffer.silent:
            ahead_s = times.outputBufferDacTime - times.currentTime
            if not 0.0 < ahead_s < _LONGEST_AHEAD_S:  # not every system fills both in
                ahead_s = self._card_latency_s
            self._note_latency(ahead_s + self._buffer.fill / self._rate_hz)

    def _on_finished(self) -> None:
        self._ended = True
