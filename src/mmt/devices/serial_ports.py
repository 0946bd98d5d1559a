"""Serial ports: opened, read without waiting, lost and opened again; frames in COBS."""

import contextlib
import errno
import os
import sys
from abc import ABC, abstractmethod
from binascii import crc_hqx
from collections import Counter
from collections.abc import Sequence
from typing import Any, ClassVar, Final, Generic, TypeVar

import serial
from serial.tools import list_ports

from mmt.core.errors import DeviceLost, MmtError

if sys.platform != "win32":
    import fcntl
    import termios

_NONE: Final = bytes(4)


def read_waiting(port: serial.Serial, most: int) -> bytes:
    """Return the bytes that wait in a port whose time-out is 0.

    An empty port is not read: on Linux such a read waits for bytes on their way through the
    kernel, for milliseconds on a busy machine, even if it must not block. Reading takes two
    system calls, not three as in pyserial.

    Raises
    ------
    OSError, TypeError
        The port is gone; TypeError if it was closed meanwhile.
    """
    if sys.platform != "win32":
        if fcntl.ioctl(port.fd, termios.FIONREAD, _NONE) == _NONE:
            return b""
        if received := os.read(port.fd, most):
            return received
    return bytes(port.read(most))  # raises if the port is gone


def explain_refusal(error: Exception) -> str:
    """Return why a port cannot be opened, with what to do."""
    code = getattr(error, "errno", None)
    if code == errno.EACCES:
        return (
            "no permission. On Linux add yourself to the group that owns it (dialout or uucp: "
            "sudo usermod -aG dialout $USER) and log in again"
        )
    if code in {errno.ENOENT, errno.ENXIO, errno.ENODEV}:
        ports = [str(info.device) for info in list_ports.comports()]
        return f"there is none; plug the board in. There are: {', '.join(ports) or 'no ports'}"
    if code in {errno.EBUSY, errno.EAGAIN}:
        return "another program has it open; close that one (a serial monitor, another session)"
    return f"{error}; check that it is a serial port, and that it can be set to this baud rate"


def is_text(received: bytes) -> bool:
    """Return whether nearly all received bytes are readable: a device sends text, not frames."""
    readable = sum(byte in b"\t\r\n" or 32 <= byte < 127 for byte in received)
    return readable >= _TEXT_SHARE * len(received)


def cobs_encode(plain: bytes) -> bytes:
    """Return bytes in COBS encoding: none of them is zero.

    Raises
    ------
    ValueError
        There are more than 253 bytes, which would need more than one extra byte.
    """
    if len(plain) > 253:
        raise ValueError(f"{len(plain)} bytes are too long for a frame")
    blocks = plain.split(b"\0")
    return b"".join(bytes((len(block) + 1,)) + block for block in blocks)


def cobs_decode(stuffed: bytes) -> bytes | None:
    """Decode COBS-encoded bytes, or return None if they are invalid."""
    plain = bytearray(stuffed)
    at, end = 0, len(plain)
    while at < end:
        following = at + plain[at]
        if following == at:
            return None
        plain[at] = 0  # each block ends with a zero; the one at 0 is not content
        at = following
    return bytes(plain[1:]) if at == end else None


def framed(plain: bytes) -> bytes:
    """Return a frame's content as it goes over the wire, with its check and its final zero."""
    return cobs_encode(plain + crc_hqx(plain, 0xFFFF).to_bytes(2, "little")) + b"\0"


Content = TypeVar("Content")


class FrameDecoder(ABC, Generic[Content]):
    """Cut a stream of bytes into frames; invalid ones are counted and left out.

    Bytes before the first zero end an earlier frame: they are dropped and not counted. A subclass
    says the version, which is a frame's first byte, and the lengths: from `_shortest` (bytes with
    the check) by `_step`, and at most `_longest` (bytes in COBS, without the zero).
    """

    _version: ClassVar[int]
    _shortest: ClassVar[int]
    _step: ClassVar = 1
    _longest: ClassVar = 254

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        """``bad frames`` (not COBS, or with impossible content), ``bad checksums``,
        ``other versions``."""
        self.reset()

    def reset(self) -> None:
        """Discard everything received."""
        self._buffer, self._synchronised = b"", False

    @abstractmethod
    def _parse(self, content: bytes) -> Content | None:
        """Return the content of a whole frame without its check; None if it is impossible."""

    def feed(self, received: bytes) -> Sequence[Content]:
        """Return the frames that these bytes complete, oldest first."""
        if not received:
            return ()
        *pieces, rest = (self._buffer + received).split(b"\0")
        frames = []
        for piece in pieces:
            if not self._synchronised:
                self._synchronised = True
            elif piece:  # two zeros in a row hold no frame
                frame = self._decode(piece)
                if frame is not None:
                    frames.append(frame)
        if len(rest) > self._longest:  # no frame is that long: skip to the next zero
            if self._synchronised:
                self.faults["bad frames"] += 1
                self._synchronised = False
            rest = b""
        self._buffer = rest
        return frames

    def _decode(self, stuffed: bytes) -> Content | None:
        plain = (cobs_decode(stuffed) if len(stuffed) <= self._longest else None) or b""
        beyond = len(plain) - self._shortest
        if beyond < 0 or beyond % self._step:
            self.faults["bad frames"] += 1
            return None
        content = plain[:-2]
        if crc_hqx(content, 0xFFFF) != plain[-2] | plain[-1] << 8:
            self.faults["bad checksums"] += 1
            return None
        if content[0] != self._version:
            self.faults["other versions"] += 1
            return None
        frame = self._parse(content)
        if frame is None:
            self.faults["bad frames"] += 1
        return frame


_AT_ONCE: Final = 16384
_TEXT_SHARE: Final = 0.95


class SerialLine:
    """A line, closed at first; a driver adds its commands.

    Parameters
    ----------
    name
        Name of the device in messages.
    port
        Path of the port, as ``/dev/ttyUSB0``.
    baud
        Bits a second.
    **settings
        Further arguments of `serial.Serial`, such as a parity.
    """

    def __init__(self, name: str, port: str, baud: int, **settings: Any) -> None:
        self.name = name
        self._path = port
        self._baud = baud
        self._settings = settings
        self._port: serial.Serial | None = None

    def open(self) -> None:
        """Open the port for this program alone, and discard its input buffer.

        Raises
        ------
        MmtError
            The port is missing, in use by another program, or not permitted; the message says what
            to do.
        """
        self.close()
        try:
            self._port = port = serial.Serial(
                self._path, self._baud, timeout=0, exclusive=True, **self._settings
            )
        except Exception as error:  # pyserial lets termios.error through, which is no OSError
            raise MmtError(f"{self.name}: its serial port: {explain_refusal(error)}") from error
        # A converter from USB to serial gathers bytes for 16 ms unless told otherwise.
        with contextlib.suppress(AttributeError, NotImplementedError, ValueError, OSError):
            port.set_low_latency_mode(True)
        with contextlib.suppress(OSError):  # as pyserial's errors are
            port.reset_input_buffer()

    def read(self) -> bytes:
        """Return the received bytes without waiting.

        Raises
        ------
        DeviceLost
            The port is closed, or gone.
        """
        try:
            return read_waiting(self._opened(), _AT_ONCE)
        except (OSError, TypeError) as error:  # TypeError: pyserial, when it is closed meanwhile
            raise self._lost(error) from error

    def write(self, content: bytes) -> None:
        """Send bytes.

        Raises
        ------
        DeviceLost
            The port is closed, or gone.
        """
        try:
            self._opened().write(content)
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close the port; calling it twice is harmless."""
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError):  # a port that is gone is closed too
                port.close()

    def _opened(self) -> serial.Serial:
        if self._port is None:
            raise DeviceLost(f"{self.name} is closed: connect it again")
        return self._port

    def _lost(self, error: Exception) -> DeviceLost:
        return DeviceLost(
            f"{self.name}: the port is gone ({error}); plug it in again, and check that no other "
            "program uses the port"
        )
