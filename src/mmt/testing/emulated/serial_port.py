"""Devices at serial ports in software: pseudo terminals that can be unplugged."""

import contextlib
import os
import random
import struct
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Final

from mmt.testing.emulated import Clockwork, FaultySending, Truth

_LARGEST: Final = 4096
_TCGETS2: Final = 0x802C542A
_TCSETS2: Final = 0x402C542B
_SPEED_AT: Final = 40
_IXANY: Final = 0x800
_SETTLED: Final = 3
"""Looks at unchanged settings before they are marked: a program sets them in two steps."""


class EmulatedSerialDevice(ABC):
    """A device at a serial line, whose other end programs open by its path.

    Parameters
    ----------
    period_ns
        How often the device does something.
    clockwork
        Clockwork whose thread runs it; None for one of its own.
    """

    _listens: ClassVar = True
    """Whether it takes what a program sends, and notes its baud rate; only on Linux."""

    def __init__(self, period_ns: int, clockwork: Clockwork | None = None) -> None:
        self.dropped = 0
        """Bytes that were not read in time, as by an overrun."""
        self._period_ns = period_ns
        self._directory = tempfile.TemporaryDirectory(prefix="mmt-port-")
        self._link = Path(self._directory.name) / "port"
        self._master = -1
        self.baud = 0
        """Bits a second that the program has set."""
        self._unmarked = 0
        self._lock = threading.Lock()
        self._due_ns = 0
        self._clockwork = clockwork or Clockwork()

    @abstractmethod
    def _step(self, due_ns: int, received: bytes) -> None:
        """Do what is due at a time (ns, the host's monotonic), with the bytes that have come."""

    @property
    def path(self) -> str:
        """Path that a program opens; it stays the same after `plug`."""
        return str(self._link)

    def start(self) -> None:
        """Plug it in; it begins to run."""
        self.plug()
        self._due_ns = time.monotonic_ns() + self._period_ns
        self._clockwork.add(self._turn)

    def stop(self) -> None:
        """End and remove the port; calling it twice is harmless."""
        self._clockwork.remove(self._turn)
        self.unplug()
        self._directory.cleanup()

    def plug(self) -> None:
        """Make the port appear."""
        import pty
        import termios
        import tty

        with self._lock:
            if self._master >= 0:
                return
            self._master, slave = pty.openpty()
            tty.setraw(slave)
            settings = termios.tcgetattr(slave)
            settings[0] |= _IXANY
            termios.tcsetattr(slave, termios.TCSANOW, settings)
            self._unmarked = 0
            self._link.symlink_to(os.ttyname(slave))
            os.close(slave)
            os.set_blocking(self._master, False)

    def unplug(self) -> None:
        """Remove the port, as when its USB plug is pulled."""
        with self._lock:
            if self._master >= 0:
                os.close(self._master)
                self._master = -1
                self._link.unlink()

    def write(self, content: bytes) -> None:
        """Send bytes to the program; bytes that its side cannot hold are dropped."""
        sent = 0
        with contextlib.suppress(OSError):  # full, or unplugged
            sent = os.write(self._master, content)
        self.dropped += len(content) - sent

    def _turn(self, now_ns: int) -> int:
        while self._due_ns <= now_ns:
            with self._lock:
                received = b""
                if self._listens and self._master >= 0:
                    self._watch_settings()
                    with contextlib.suppress(OSError):  # nothing came, or it is not open
                        received = os.read(self._master, _LARGEST)
                self._step(self._due_ns, received)
            self._due_ns += self._period_ns
        return self._due_ns

    def _watch_settings(self) -> None:
        """Note the baud rate, and mark the settings.

        A pseudo terminal has no parity, and setting a parity is an error if nothing else changes:
        a second program could not open the port. The mark gives it something to change.
        """
        import fcntl

        settings = bytearray(44)
        fcntl.ioctl(self._master, _TCGETS2, settings)
        (self.baud,) = struct.unpack_from("=I", settings, _SPEED_AT)
        (flags,) = struct.unpack_from("=I", settings)
        self._unmarked = 0 if flags & _IXANY else self._unmarked + 1
        if self._unmarked >= _SETTLED:  # the program has done with its settings
            struct.pack_into("=I", settings, 0, flags | _IXANY)
            fcntl.ioctl(self._master, _TCSETS2, settings)


class EmulatedSerialSensor(EmulatedSerialDevice, FaultySending):
    """A sensor that takes commands and streams records, with faults on demand.

    Parameters
    ----------
    truth
        Gives what it measures at a time (ns) of the host's monotonic clock.
    baud
        Bits a second that it is set to. A program that opens the port at another rate reads
        garbage, and the sensor does not understand it.
    seed
        Seed of the noise and the faults.
    period_ns, clockwork
        As for `EmulatedSerialDevice`.
    """

    def __init__(
        self,
        truth: Truth,
        baud: int,
        seed: int,
        period_ns: int,
        clockwork: Clockwork | None = None,
    ) -> None:
        super().__init__(period_ns, clockwork)
        self.deaf = False
        """Whether commands are ignored."""
        self.truth = truth
        self._baud = baud
        self._random = random.Random(seed)  # noqa: S311 - noise, no secret
        self._received = b""
        self._garbage = b""

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the driver finds it."""
        return {"port": self.path, "baud": self._baud}

    def garble(self, content: bytes) -> None:
        """Send these bytes between two records."""
        self._garbage += content

    def _understands(self) -> bool:
        """Return whether the program has set the sensor's rate."""
        return self.baud == self._baud

    def _send(self, packet: bytes) -> None:
        """Send records as the program reads them at its rate."""
        self.write(packet if self._understands() else self._random.randbytes(len(packet)))
