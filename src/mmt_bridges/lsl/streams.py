"""Streams of the Lab Streaming Layer (LSL), by pylsl: one of frames, one of events.

They are described as in https://github.com/sccn/xdf/wiki/Meta-Data.
"""

import socket
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError, brief
from mmt.core.extras import require
from mmt.core.frames import FIELD_OF_CHANNEL, Channel
from mmt.leader.publishing import Block, Marker
from mmt.session.data import axis_columns

_UNITS: Final[dict[Channel, str]] = {"position": "mm", "force": "N", "acceleration": "m/s2"}
_BUFFERED_S: Final = 60
"""What liblsl keeps for a recipient that does not fetch it."""


class Streams:
    """The two outlets: samples at a nominal rate, and markers.

    Parameters
    ----------
    name
        The streams' names are this with ``-frames`` and ``-events`` behind it.
    channels
        What the frames carry.
    rate_hz
        Nominal rate.
    session_id
        Stands in the description of both.

    Raises
    ------
    InputError
        liblsl is not installed.
    """

    def __init__(
        self, name: str, channels: Sequence[Channel], rate_hz: float, session_id: str
    ) -> None:
        lsl = load_pylsl()
        self.clock_s: Callable[[], float] = lsl.local_clock
        self._fields = [FIELD_OF_CHANNEL[channel] for channel in channels]
        source = f"mmt-{socket.gethostname()}-{name}"
        frames = lsl.StreamInfo(
            f"{name}-frames",
            "Haptics",
            3 * len(channels),
            rate_hz,
            lsl.cf_float32,
            f"{source}-frames",
        )
        _describe(frames, channels)
        events = lsl.StreamInfo(
            f"{name}-events", "Markers", 1, lsl.IRREGULAR_RATE, lsl.cf_string, f"{source}-events"
        )
        for info in (frames, events):
            info.desc().append_child_value("manufacturer", "mmt")
            info.desc().append_child_value("session_id", session_id)
        self._frames = lsl.StreamOutlet(frames, max_buffered=_BUFFERED_S)
        self._events = lsl.StreamOutlet(events, max_buffered=_BUFFERED_S)

    @property
    def have_recipients(self) -> bool:
        """Whether somebody receives one of them."""
        return bool(self._frames.have_consumers() or self._events.have_consumers())

    def push_frames(self, blocks: Sequence[Block]) -> None:
        """Push blocks of frames, one sample a frame with a stamp of its own."""
        values = [
            np.concatenate([block.frames[field] for block in blocks]) for field in self._fields
        ]
        stamps_ns = np.concatenate([b.frames["time_ns"] + b.ahead_ns for b in blocks])
        self._frames.push_chunk(np.concatenate(values, axis=1), (stamps_ns / 1e9).tolist())

    def push_marker(self, marker: Marker) -> None:
        """Push an event."""
        self._events.push_sample([marker.text], marker.time_ns / 1e9)


def _describe(info: Any, channels: Sequence[Channel]) -> None:
    """Describe the channels, and say that frames may be missing: importers keep the stamps then."""
    described = info.desc().append_child("channels")
    for channel in channels:
        for axis, label in zip("XYZ", axis_columns(channel), strict=True):
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
        It, or the library liblsl, is not installed.
    """
    require("pylsl")
    try:
        import pylsl
    except (RuntimeError, OSError, AttributeError) as error:  # AttributeError: a library too old
        raise InputError(
            f"[lsl] needs the library liblsl, which pylsl cannot load ({brief(error)}); on Linux "
            "its package for x86-64 with glibc 2.35 or later contains it; elsewhere install "
            "liblsl, and name the file in the variable PYLSL_LIB"
        ) from error
    return pylsl
