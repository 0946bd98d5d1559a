"""``adxl335-serial``: an ADXL335 behind a microcontroller, and the frames that it sends.

A frame is COBS-encoded (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) and ended by
a zero byte. Before the encoding it holds, little-endian: version (u8), number of the last sample
(u32), the board's time of the last sample (u32, us), n times three converter counts (u16), and
CRC-16 of all that (polynomial 0x1021, initial value 0xFFFF). n is 1 to 32 and follows from
the length.
"""

import os
import struct
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from serial.tools import list_ports

from mmt.core.arrays import Vector
from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.adxl335.sensor import BAND, Adxl335, SerialOptions
from mmt.devices.drivers import read_options
from mmt.devices.protocols import SensorReading
from mmt.devices.serial_ports import FrameDecoder, SerialLine, framed

VERSION: Final = 1
MOST_SAMPLES: Final = 32
"""Samples in one frame at most: it then stays below 254 bytes, and COBS adds exactly one byte."""

Counts = tuple[int, int, int]
"""x, y, z in counts of the converter."""

_HEAD: Final = struct.Struct("<BII")
_SAMPLE: Final = struct.Struct("<HHH")
_OVERHEAD: Final = _HEAD.size + 2


class BoardFrame(NamedTuple):
    """Samples that the board sent together."""

    sequence: int
    """Number of the last sample, modulo 2^32."""
    time_us: int
    """Board's own time of the last sample, modulo 2^32."""
    samples: tuple[Counts, ...]
    """Oldest first."""


def encode_frame(frame: BoardFrame) -> bytes:
    """Return a frame as it goes over the wire, with its final zero.

    Raises
    ------
    ValueError
        No sample, or more than 32.
    """
    if not 1 <= len(frame.samples) <= MOST_SAMPLES:
        raise ValueError(f"a frame holds 1 to {MOST_SAMPLES} samples, not {len(frame.samples)}")
    plain = _HEAD.pack(VERSION, frame.sequence, frame.time_us)
    plain += b"".join(_SAMPLE.pack(*sample) for sample in frame.samples)
    return framed(plain)


class BoardDecoder(FrameDecoder[BoardFrame]):
    """Decoder of the board's frames."""

    _version = VERSION
    _shortest = _OVERHEAD + _SAMPLE.size
    _step = _SAMPLE.size
    _longest = _OVERHEAD + MOST_SAMPLES * _SAMPLE.size + 1

    def _parse(self, content: bytes) -> BoardFrame:
        _, sequence, time_us = _HEAD.unpack_from(content)
        if len(content) == _HEAD.size + _SAMPLE.size:  # the usual case, twice as quick
            return BoardFrame(sequence, time_us, (_SAMPLE.unpack_from(content, _HEAD.size),))
        return BoardFrame(sequence, time_us, tuple(_SAMPLE.iter_unpack(content[_HEAD.size :])))


_MASK: Final = 0xFFFFFFFF
_LARGEST_GAP: Final = 1 << 20
"""Samples; if the counter moves by more, or backwards, the board has restarted."""
_RESTART_GAP_US: Final = 1000


class Timeline:
    """Give the samples of successive frames their times, and count lost samples.

    A frame gives the number and the time of its last sample. Its other samples are spaced evenly
    between the previous frame's last sample and this one. Of the first frame, which has no
    previous frame, only the last sample is used.
    """

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        """``lost samples``, ``repeated frames``, ``restarts`` of the board."""
        self._last: BoardFrame | None = None
        self._time_us = 0

    def place(self, frame: BoardFrame) -> Sequence[tuple[int, Counts]]:
        """Return the frame's samples as (time_ns, counts), oldest first.

        Times begin with the board's first time stamp. They never go back, even if the board's
        32-bit counter wraps (every 71.6 minutes) or the board restarts.
        """
        last, self._last = self._last, frame
        if last is None:
            self._time_us = frame.time_us
            return ((frame.time_us * 1000, frame.samples[-1]),)
        step = (frame.sequence - last.sequence) & _MASK
        if step == 0:
            self._last = last
            self.faults["repeated frames"] += 1
            return ()
        if step > _LARGEST_GAP:
            self.faults["restarts"] += 1
            self._time_us += _RESTART_GAP_US
            return ((self._time_us * 1000, frame.samples[-1]),)
        elapsed_us = (frame.time_us - last.time_us) & _MASK
        self._time_us += elapsed_us
        end_ns = self._time_us * 1000
        samples = frame.samples
        if step == len(samples) == 1:  # the usual case, several times as quick
            return ((end_ns, samples[0]),)
        number = min(len(samples), step)
        if step > number:
            self.faults["lost samples"] += step - number
        return tuple(
            (end_ns - elapsed_us * 1000 * back // step, samples[-1 - back])
            for back in range(number - 1, -1, -1)
        )


NAME: Final = "adxl335-serial"
RATES: Final = f"2000 samples a second, or what its sketch is changed to; {BAND}"
_FIRST_FRAMES: Final = 3
"""Good frames that must come before the board counts as connected."""
_TEXT_SHARE: Final = 0.95


class SerialAdxl335(Adxl335):
    """Reads the frames that ``docs/reference/accelerometer-framing.md`` describes.

    Parameters
    ----------
    options
        See `mmt.devices.adxl335.sensor.SerialOptions`.

    Raises
    ------
    InputError
        An option is not allowed.
    """

    def __init__(self, **options: Any) -> None:
        self._options = read_options(SerialOptions, NAME, options)
        super().__init__(self._options)
        self._volts_per_count = self._options.volts_per_count
        port = self._options.port
        self._line = SerialLine(
            f"the accelerometer's board on {port}", port, self._options.baud_rate
        )
        self._decoder = BoardDecoder()
        self._timeline = Timeline()
        self._earlier: Counter[str] = Counter()
        self._newest: Counts | None = None
        self._survived = 0  # invalid frames before the newest good one
        self._stuck_at: Counts | None = None

    def connect(self) -> None:
        """Open the port and wait for the board's first frames.

        Raises
        ------
        MmtError
            The port cannot be opened, or no frames come; the message explains what came instead.
        """
        self._earlier.update(self._decoder.faults)
        self._earlier.update(self._timeline.faults)
        self._timeline = Timeline()
        self._decoder = BoardDecoder()
        self._survived = 0
        self._line.open()
        try:
            self._wait_for_frames()
        except Exception:
            self._line.close()
            raise
        self._prepare(_serial_number(self._options.port))

    def voltages(self) -> Sequence[tuple[int, Vector]]:
        """Return the new samples as (time_ns, volts along the sensor's own axes).

        Raises
        ------
        DeviceLost
            The board was unplugged.
        """
        scale = self._volts_per_count
        place = self._timeline.place
        placed: list[tuple[int, Vector]] = []
        frames = self._decoder.feed(self._line.read())
        if frames:
            self._newest = frames[-1].samples[-1]
            self._survived = self._decoder.faults.total()
        for frame in frames:
            for time_ns, (x, y, z) in place(frame):
                placed.append((time_ns, (x * scale, y * scale, z * scale)))
        return placed

    def explain_fault(self) -> str:
        """Return the problem if only invalid frames have come since the last good one, else ""."""
        broken = self._decoder.faults.total() - self._survived
        if broken <= 0:
            return ""
        return (
            f"{self._line.name} sends no good frames ({broken} were broken): check its cable, and "
            f"that the baud rate is still {self._options.baud_rate}"
        )

    def read(self) -> Sequence[SensorReading]:
        """Return the new readings, in m/s2 along the scene's axes; see `Adxl335.read`."""
        try:
            return super().read()
        except DeviceLost:
            if self._converter.stuck_at is not None:
                self._stuck_at = self._newest
            raise

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        self._line.close()

    def _counters(self) -> Sequence[Mapping[str, int]]:
        now = Counter(self._earlier)
        now.update(self._decoder.faults)
        now.update(self._timeline.faults)
        return (now, *super()._counters())

    def _wait_for_frames(self) -> None:
        received = bytearray()
        frames: list[BoardFrame] = []
        end = time.monotonic() + self._options.start_s
        while time.monotonic() < end:
            got = self._line.read()
            received += got
            del received[:-4096]
            frames.extend(self._decoder.feed(got))
            moved = frames and frames[-1].samples[-1] != self._stuck_at
            if len(frames) >= _FIRST_FRAMES and moved:
                self._stuck_at = None
                return
            time.sleep(0.002)
        raise MmtError(self._explain(bytes(received), frames))

    def _explain(self, received: bytes, frames: Sequence[BoardFrame]) -> str:
        where = self._line.name
        if frames and self._stuck_at is not None:
            return (
                f"{where} still sends one value that never changes: check the sensor's supply and "
                "the wires to the converter"
            )
        if not received:
            return (
                f"{where} sent nothing for {self._options.start_s:g} s: check that the sketch of "
                "scripts/firmware is on it and that this is its port"
            )
        if self._decoder.faults["other versions"]:
            return f"{where} sends frames of another version: put the present sketch on it"
        readable = sum(byte in b"\t\r\n" or 32 <= byte < 127 for byte in received)
        if readable >= _TEXT_SHARE * len(received):
            return f"{where} sends text: another sketch runs on it; put that of scripts/firmware on"
        return (
            f"{where} sent {len(received)} bytes or more but no good frames: the baud rate is "
            f"probably not {self._options.baud_rate} (option baud_rate; the sketch says which), or "
            "another sketch runs on it"
        )


def _serial_number(port: str) -> str | None:
    """Return the serial number that the board at a port reports over USB, or None."""
    here = os.path.realpath(port)
    for info in list_ports.comports():
        if os.path.realpath(info.device) == here:
            number: str | None = info.serial_number
            return number
    return None
