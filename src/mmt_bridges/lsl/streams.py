"""Streams of frames and of events for the Lab Streaming Layer (LSL), by pylsl.

If a frame has several samples of acceleration, these have a stream of their own.

The streams are described as in https://github.com/sccn/xdf/wiki/Meta-Data.
"""

import socket
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError, short_message
from mmt.core.extras import require
from mmt.core.frames import FIELD_OF_CHANNEL, Channel, axes_of
from mmt.leader.publishing import Block, Marker
from mmt.session.data import FRAME_PERIOD_NS, axis_columns, sample_times, sampled_parts

_UNITS: Final[dict[Channel, str]] = {
    "position": "mm",
    "force": "N",
    "acceleration": "m/s2",
    "orientation": "quaternion",
}
MANUFACTURER: Final = "mmt"
UTC_AHEAD: Final = "utc_ahead_ns"
"""UTC since 1970 minus LSL's clock, from which a reader knows the date of a recording."""
_BUFFERED_S: Final = 60
"""Seconds of samples that liblsl keeps for a recipient that does not fetch them."""


class Streams:
    """The outlets: samples at nominal rates, and markers.

    Parameters
    ----------
    name
        Beginning of the streams' names; ``-frames``, ``-acceleration`` or ``-events`` follows.
    channels
        Channels of the frames.
    rate_hz
        Nominal rate of the frames.
    samples_per_frame
        Samples of acceleration in a frame.
    session_id
        Identifier of the session, for the description of each stream.

    Raises
    ------
    InputError
        liblsl is not installed.
    """

    def __init__(
        self,
        name: str,
        channels: Sequence[Channel],
        rate_hz: float,
        samples_per_frame: int,
        session_id: str,
    ) -> None:
        lsl = load_pylsl()
        self.clock_s: Callable[[], float] = lsl.local_clock
        ahead_ns = time.time_ns() - round(lsl.local_clock() * 1e9)
        source = f"mmt-{socket.gethostname()}-{name}"

        def outlet(part: str, kind: str, rate_hz: float, form: Any, of: Sequence[Channel]) -> Any:
            width = sum(len(axes_of(channel)) for channel in of) or 1
            info = lsl.StreamInfo(f"{name}-{part}", kind, width, rate_hz, form, f"{source}-{part}")
            if of:
                _describe(info, of)
            info.desc().append_child_value("manufacturer", MANUFACTURER)
            info.desc().append_child_value(UTC_AHEAD, str(ahead_ns))
            info.desc().append_child_value("session_id", session_id)
            return lsl.StreamOutlet(info, max_buffered=_BUFFERED_S)

        names = ("frames", "acceleration")
        self._sampled: list[tuple[Any, Sequence[Channel], int]] = [
            (outlet(names[k > 1], "Haptics", k * rate_hz, lsl.cf_float32, of), of, k)
            for of, k in sampled_parts(channels, samples_per_frame)
        ]
        self._events = outlet("events", "Markers", lsl.IRREGULAR_RATE, lsl.cf_string, ())

    @property
    def has_recipients(self) -> bool:
        """Whether any of the streams has a recipient."""
        outlets = [self._events, *(outlet for outlet, _, _ in self._sampled)]
        return any(outlet.have_consumers() for outlet in outlets)

    def push_frames(self, blocks: Sequence[Block]) -> None:
        """Push blocks of frames, each sample with a stamp of its own."""
        stamps_ns = np.concatenate([b.frames["time_ns"] + b.ahead_ns for b in blocks])
        for outlet, channels, samples in self._sampled:
            values = [
                np.concatenate([b.frames[FIELD_OF_CHANNEL[channel]] for b in blocks]).reshape(
                    -1, len(axes_of(channel))
                )
                for channel in channels
            ]
            stamps_s = (sample_times(stamps_ns, samples, FRAME_PERIOD_NS) / 1e9).tolist()
            outlet.push_chunk(np.concatenate(values, axis=1), stamps_s)

    def push_marker(self, marker: Marker) -> None:
        """Push an event."""
        self._events.push_sample([marker.text], marker.time_ns / 1e9)


def _describe(info: Any, channels: Sequence[Channel]) -> None:
    """Describe the channels, and that samples may be missing, so that importers keep the stamps."""
    described = info.desc().append_child("channels")
    for channel in channels:
        for axis, label in zip(axes_of(channel).upper(), axis_columns(channel), strict=True):
            one = described.append_child("channel")
            one.append_child_value("label", label)
            one.append_child_value("unit", _UNITS[channel])
            one.append_child_value("type", f"{channel.capitalize()}{axis}")
    info.desc().append_child("synchronization").append_child_value("can_drop_samples", "true")


def load_pylsl() -> Any:
    """Import pylsl.

    Raises
    ------
    InputError
        pylsl, or the library liblsl, is not installed.
    """
    require("pylsl")
    try:
        import pylsl
    except (RuntimeError, OSError, AttributeError) as error:  # AttributeError: a library too old
        raise InputError(
            f"[lsl] needs the library liblsl, which pylsl cannot load ({short_message(error)}); on "
            "Linux its package for x86-64 with glibc 2.35 or later contains it; elsewhere install "
            "liblsl, and name the file in the variable PYLSL_LIB"
        ) from error
    return pylsl
