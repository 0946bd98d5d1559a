"""Emulated force sensor by Bota Systems, on a pseudo terminal, and its driver in a virtual lab."""

import re
import time
from typing import TYPE_CHECKING, ClassVar, Final

from mmt.testing.emulated import Clockwork, Truth
from mmt.testing.emulated.drivers import VirtualSensor
from mmt.testing.emulated.serial_port import EmulatedSerialSensor
from mmt_devices.bota.frames import HEADER, RAW, SIZE, BotaFrame, frame_rate_hz, pack_frame

if TYPE_CHECKING:
    from mmt.testing.emulated.lab import World


_BAUD: Final = 460_800
_TIMER_NS: Final = 1_000_000
"""A USB-to-serial adapter passes bytes on once a millisecond."""
_SHIPPED_FILTER: Final = (512, 0, 0, 1)
_GREETING: Final = b"App Init\r\nname: BFT-SENS-SER-M8\r\nS/N: 1234\r\nFW version: 1.5.0\r\n"
_COMMAND: Final = re.compile(rb"[CRI]|c,(\d),(\d),(\d),(\d)|f,(\d+),(\d),(\d),(\d)")
_WARMTH_C: Final = 31.5


class EmulatedBota(EmulatedSerialSensor):
    """Answer and stream as the sensor does, with faults on demand.

    Parameters
    ----------
    truth, seed, clockwork
        As for `EmulatedSerialSensor`; the truth is the force (N).
    clock_ppm, start_us
        By how much the sensor's clock runs too fast, in ppm, and its initial time.
    noise_n
        Standard deviation of the noise on a force.
    """

    def __init__(
        self,
        truth: Truth,
        *,
        clock_ppm: float = 0.0,
        start_us: int = 0,
        noise_n: float = 0.01,
        seed: int = 1,
        clockwork: Clockwork | None = None,
    ) -> None:
        super().__init__(truth, _BAUD, seed, _TIMER_NS, clockwork)
        self.filter = _SHIPPED_FILTER
        """Sinc length, chop, fast, FIR disabled."""
        self.calibrated = True
        self.text = False
        """Whether lines of text are sent instead of frames."""
        self.header = HEADER
        """Header of a frame; another value emulates a model with another protocol."""
        self.status = 0
        """Status bits of the frames from now on."""
        self.refusal = 0
        """Return code of answers; 0 accepts a command."""
        self._speed = 1.0 + 1e-6 * clock_ppm
        self._start_us = start_us
        self._noise = noise_n
        self._on_line_ns = round(10 * SIZE * 1e9 / _BAUD)
        self._booted_ns = 0
        self._running_ns: int | None = None  # when the stream began
        self._sent = 0
        self._values = (0.0, 0.0, 0.0)
        self._repeats = 0
        self._last = b""

    def unplug(self) -> None:
        """Make the port vanish, and cut the power: only the stored factory settings stay."""
        super().unplug()
        self._running_ns = None
        self._start_us = 0
        self.filter, self.text, self.calibrated = _SHIPPED_FILTER, False, True

    def plug(self) -> None:
        """Make the port appear; the sensor starts, and begins to stream."""
        self._boot()
        super().plug()

    def restart(self) -> None:
        """Restart the sensor's clock at 0, but keep the settings."""
        self._start_us = 0
        self._booted_ns = time.monotonic_ns()

    def repeat(self, frames: int = 1) -> None:
        """Send the last frame again instead of each of the next ones."""
        self._repeats += frames

    def _boot(self) -> None:
        self._booted_ns = time.monotonic_ns()
        self._received = b""
        self._garbage = _GREETING
        self._stream(self._booted_ns)

    def _stream(self, now_ns: int) -> None:
        self._running_ns, self._sent = now_ns, 0

    def _step(self, due_ns: int, received: bytes) -> None:
        if self._running_ns is not None:
            self._send_due(self._running_ns, due_ns)
        if received and self._understands() and not self.deaf:
            self._received += received
            while command := _COMMAND.match(self._received):
                self._received = self._received[command.end() :]
                self._obey(command, due_ns)

    def _obey(self, command: "re.Match[bytes]", now_ns: int) -> None:
        name = command[0][:1].decode("ascii")
        code = self.refusal
        if name in "CI":
            self._running_ns = None
        elif name != "R" and self._running_ns is not None:
            code = 1  # settings need the configuration mode
        elif not code and name == "c":
            self.calibrated, self.text = command[2] == b"1", command[3] == b"1"
        elif not code and name == "f":
            length, chop, fast, no_fir = (int(command[i]) for i in range(5, 9))
            self.filter = (length, chop, fast, no_fir)
        self.write(f"r,0,{name},{code}\r\n".encode("ascii"))
        if name == "R" and not code:
            self._stream(now_ns)

    def _send_due(self, running_ns: int, now_ns: int) -> None:
        rate = frame_rate_hz(self.filter[0]) * self._speed * 1e-9
        due = max(0, int((now_ns - running_ns - self._on_line_ns) * rate))
        numbers, self._sent = range(self._sent, due), due
        if not numbers:
            return
        packet, self._garbage = self._garbage, b""
        if not self._silent:
            packet += b"".join(self._frame(running_ns + round((k + 1) / rate)) for k in numbers)
        self._send(packet)

    def _frame(self, time_ns: int) -> bytes:
        if self._repeats and self._last:
            self._repeats -= 1
            return self._last
        if not self.stuck:
            x, y, z = (
                value + self._random.gauss(0.0, self._noise) for value in self.truth(time_ns)
            )
            self._values = (x, y, z)
        x, y, z = self._values
        if self.text:
            return f"{x:.3f},{y:.3f},{z:.3f}\r\n".encode("ascii")
        status = self.status
        if not self.calibrated:
            x, y, z = 1e5 * x, 1e5 * y, 1e5 * z
            status |= RAW
        time_us = self._start_us + round((time_ns - self._booted_ns) * self._speed / 1000.0)
        wrench = (x, y, z, 0.001 * y, 0.001 * x, 0.0)
        whole = BotaFrame(status, wrench, time_us % 2**32, _WARMTH_C)
        self._last = self._spoil(pack_frame(whole, self.header))
        return self._last


def in_lab(world: "World", seed: int, clockwork: Clockwork) -> EmulatedBota:
    """Return the force sensor of the virtual lab."""
    return EmulatedBota(world.force_n, clock_ppm=25.0, seed=seed, clockwork=clockwork)


class VirtualBota(VirtualSensor):
    """Another force sensor of the virtual lab; takes the options of ``bota-serial`` too."""

    NAME, DRIVER, ADDRESS = "virtual-bota", "bota-serial", "bota"
    NEEDED: ClassVar = {"port": "lab"}
