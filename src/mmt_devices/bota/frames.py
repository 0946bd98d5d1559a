"""Bota Systems' serial protocol: frames of the stream, commands and their answers.

Source: the vendor's public ROS driver (bota_driver, package rokubimini_serial: RokubiminiSerialImpl
and RokubiminiSerialCommunication) and its Python example for serial sensors. All numbers are
little-endian. A frame is the header 0xAA, then status (u16), Fx, Fy, Fz (N) and Tx, Ty, Tz (N m) as
float32, the sensor's time (u32, us), its temperature (float32, degree Celsius), and the CRC-16/X.25
of the bytes between header and CRC.
"""

import re
import struct
from binascii import crc_hqx
from collections import Counter
from typing import Final, NamedTuple

from mmt.devices.wrench import Six

HEADER: Final = 0xAA
SIZE: Final = 37
_CONTENT: Final = struct.Struct("<H6fIf")
_CHECK_AT: Final = SIZE - 2

SKIPPED: Final = 0x01
OVERRANGE: Final = 0x02
INVALID: Final = 0x04
RAW: Final = 0x08
"""Bits of the status, in this order: measurements were skipped; a force is beyond its range; a
gauge is in saturation, short or open; the values are those of gauges instead of forces."""

_MIRRORED: Final = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in the reverse order."""

BAUD_CODES: Final = {9600: 0, 57_600: 1, 115_200: 2, 230_400: 3, 460_800: 4}
"""Bits a second -> their code in the communication setup."""

_SINC_HZ: Final = 51_200.0

CONFIGURE: Final = "C"
RUN: Final = "R"
ANSWER: Final = re.compile(rb"r,\d,(\w),(\d)")
"""Answer with its command and return code; code 0 is success."""


class BotaFrame(NamedTuple):
    """Content of one frame."""

    status: int
    wrench: Six
    """Fx, Fy, Fz (N), Tx, Ty, Tz (N m)."""
    time_us: int
    """By the sensor's clock, modulo 2^32."""
    temperature_c: float


def frame_rate_hz(sinc_length: int) -> float:
    """Return how many frames a second the sensor sends, by the length of its sinc filter."""
    return _SINC_HZ / sinc_length


def most_frames_hz(baud: int) -> float:
    """Return how many frames a second the line carries: ten bits a byte."""
    return baud / (10 * SIZE)


def setup_command(baud: int) -> str:
    """Return the communication setup: no temperature compensation, calibrated, binary."""
    return f"c,0,1,0,{BAUD_CODES[baud]}"


def filter_command(sinc_length: int, *, fir: bool) -> str:
    """Return the setup of the filter, with chop and fast off as in the vendor's example."""
    return f"f,{sinc_length},0,0,{0 if fir else 1}"


def checksum(content: bytes) -> int:
    """Return the CRC-16/X.25.

    Python's `crc_hqx` has the same polynomial, but takes the highest bit first. This CRC takes the
    lowest bit first, so the bits of each byte and of the result are mirrored.
    """
    crc = crc_hqx(content.translate(_MIRRORED), 0xFFFF) ^ 0xFFFF
    return _MIRRORED[crc & 0xFF] << 8 | _MIRRORED[crc >> 8]


def pack_frame(frame: BotaFrame, header: int = HEADER) -> bytes:
    """Return the frame's bytes."""
    content = _CONTENT.pack(frame.status, *frame.wrench, frame.time_us, frame.temperature_c)
    return bytes([header]) + content + checksum(content).to_bytes(2, "little")


class FrameStream:
    """Find frames in a stream of bytes, also again after garbage.

    Parameters
    ----------
    faults
        Counts, as ``broken frame``, those with a wrong header or CRC; garbage counts as frames of
        the same length.
    """

    def __init__(self, faults: Counter[str]) -> None:
        self.faults = faults
        self.reset()

    def reset(self) -> None:
        """Discard everything received."""
        self._rest = b""
        self._skipped = 0

    def feed(self, received: bytes) -> list[BotaFrame]:
        """Take bytes and return the frames that are complete and valid."""
        content = self._rest + received if self._rest else received
        frames: list[BotaFrame] = []
        start, end = 0, len(content)
        while end - start >= SIZE:
            if content[start] == HEADER and _is_right(content, start):
                status, u, v, w, x, y, z, time_us, warmth = _CONTENT.unpack_from(content, start + 1)
                frames.append(BotaFrame(status, (u, v, w, x, y, z), time_us, warmth))
                self._skipped = 0
                start += SIZE
                continue
            place = content.find(HEADER, start + 1)
            step = (place if place >= 0 else end) - start
            self._skip(step)
            start += step
        self._rest = content[start:]
        return frames

    def _skip(self, number: int) -> None:
        """Count bytes outside frames: each 37 in a row, or a shorter rest, as one broken frame."""
        counted = -(-self._skipped // SIZE)
        self._skipped += number
        self.faults["broken frame"] += -(-self._skipped // SIZE) - counted


def _is_right(content: bytes, start: int) -> bool:
    at = start + _CHECK_AT
    return checksum(content[start + 1 : at]) == content[at] | content[at + 1] << 8
