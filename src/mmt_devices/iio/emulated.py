"""Emulated accelerometer of Linux's industrial I/O, and its driver in a virtual lab.

It reacts to written attributes as the kernel does, but unlike the kernel it refuses no value.
"""

import contextlib
import os
import random
import shutil
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mmt.testing.emulated import Clockwork, FaultySending, Truth
from mmt.testing.emulated.drivers import VirtualSensor
from mmt_devices.iio.emulated_chips import ADXL355, ADXL359, Chip, attributes, pack
from mmt_devices.iio.layout import Element, parse_element

if TYPE_CHECKING:
    from mmt.testing.emulated.lab import World


_LEAST_WAIT_NS: Final = 100_000
_IDLE_NS: Final = 10_000_000
_PIPE_BYTES: Final = 65_536


class EmulatedIio(FaultySending):
    """Attributes and scans of one device, with faults on demand.

    Parameters
    ----------
    truth
        Proper acceleration (m/s2) along the sensor's own axes at a monotonic time (ns).
    chip
        Model of the sensor.
    clock_ppm
        By how much the sensor samples too fast, in ppm.
    noise_m_s2
        Standard deviation of the noise on each axis.
    seed
        Seed of the noise and the faults.
    old
        Whether the device has the directories of kernels before 5.11, which later kernels have
        too, or only the new ones.
    clockwork
        Clockwork whose thread runs the device; None for one of its own.
    """

    def __init__(
        self,
        truth: Truth,
        chip: Chip = ADXL355,
        *,
        clock_ppm: float = 0.0,
        noise_m_s2: float = 0.02,
        seed: int = 1,
        old: bool = True,
        clockwork: Clockwork | None = None,
    ) -> None:
        self.dropped = 0
        """Scans for which the buffer had no room."""
        self.chip = chip
        """Model of the sensor; may be changed before `start`."""
        self._buffer = "buffer" if old else "buffer0"
        self._elements = "scan_elements" if old else self._buffer
        self.truth = truth
        self._speed = 1.0 + 1e-6 * clock_ppm
        self._noise = noise_m_s2
        self._random = random.Random(seed)  # noqa: S311 - noise, no secret
        self._folder = Path(tempfile.mkdtemp(prefix="mmt-iio-"))
        self._lock = threading.Lock()
        self._clockwork = clockwork or Clockwork()
        self._file = self._switch = -1
        self._seen: tuple[str, int] = ("0", 0)
        self._enabled: list[Element] = []
        self._begun_ns: int | None = None
        self._rate_hz = 0.0
        self._length = 0
        self._sent = 0
        self._realtime = False
        self._raw: tuple[int, ...] = ()
        self._scrambled = False
        self._splits = 0
        self._held = b""

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the driver finds the device."""
        return {"sysfs_root": str(self._folder / "sys"), "dev_root": str(self._folder / "dev")}

    @property
    def directory(self) -> Path:
        """Directory of the device's attributes."""
        return self._folder / "sys" / "iio:device0"

    def start(self) -> None:
        """Plug the device in, and start it."""
        self.plug()
        self._clockwork.add(self._turn)

    def stop(self) -> None:
        """End, and remove the folder."""
        self._clockwork.remove(self._turn)
        self.unplug()
        shutil.rmtree(self._folder)

    def plug(self) -> None:
        """Make the device appear, with the initial settings of the kernel's driver."""
        import fcntl

        with self._lock:
            for path, content in attributes(self.chip, self._buffer, self._elements).items():
                self.write(path, content)
            self._switch = os.open(self.directory / self._buffer / "enable", os.O_RDONLY)
            node = self._folder / "dev" / "iio:device0"
            node.parent.mkdir(exist_ok=True)
            os.mkfifo(node)
            self._file = os.open(node, os.O_RDWR | os.O_NONBLOCK)
            fcntl.fcntl(self._file, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)

    def unplug(self) -> None:
        """Make the device vanish, as if its bus had lost it."""
        with self._lock:
            if self._file >= 0:
                os.close(self._file)
                os.close(self._switch)
                self._file = self._switch = -1
                self._begun_ns, self._seen = None, ("0", 0)
                shutil.rmtree(self._folder / "sys")
                shutil.rmtree(self._folder / "dev")

    def read(self, attribute: str) -> str:
        """Return the content of an attribute of the device."""
        return (self.directory / attribute).read_text(encoding="ascii").strip()

    def write(self, attribute: str, value: str) -> None:
        """Write an attribute, as the kernel or another program does."""
        path = self.directory / attribute
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(value + "\n", encoding="ascii")

    def scramble(self, *, scrambled: bool = True) -> None:
        """Give the scans impossible time stamps, or correct ones again."""
        self._scrambled = scrambled

    def split(self, scans: int = 1) -> None:
        """Deliver each of the next scans in two parts."""
        self._splits += scans

    def _turn(self, now_ns: int) -> int:
        with self._lock:
            if self._file >= 0:
                with contextlib.suppress(FileNotFoundError, ValueError):
                    self._obey(now_ns)
            if self._begun_ns is None:
                return now_ns + _IDLE_NS
            return max(self._send_due(self._begun_ns, now_ns), now_ns + _LEAST_WAIT_NS)

    def _obey(self, now_ns: int) -> None:
        """Start or stop if the attribute ``enable`` was written, even with the same value."""
        written = os.pread(self._switch, 8, 0).decode("ascii").strip()
        seen = (written, os.fstat(self._switch).st_mtime_ns)
        if seen == self._seen or not seen[0]:  # empty: it is being written
            return
        self._seen = seen
        if seen[0] == "0":
            self._begun_ns = None
            return
        with contextlib.suppress(BlockingIOError):  # a capture begins with an empty buffer
            while os.read(self._file, _PIPE_BYTES):
                pass
        elements = self._elements
        names = [path.name.removesuffix("_en") for path in (self.directory / elements).glob("*_en")]
        enabled = [
            parse_element(
                name, self.read(f"{elements}/{name}_index"), self.read(f"{elements}/{name}_type")
            )
            for name in names
            if self.read(f"{elements}/{name}_en") != "0"
        ]
        self._enabled = sorted(enabled, key=lambda element: element.index)
        self._rate_hz = float(self.read("in_accel_sampling_frequency"))
        self._length = int(self.read(f"{self._buffer}/length"))
        clock = self.read("current_timestamp_clock") if self.chip.triggered else "monotonic"
        self._realtime = clock != "monotonic"
        self._begun_ns, self._sent, self._held = now_ns, 0, b""

    def _send_due(self, begun_ns: int, now_ns: int) -> int:
        """Capture the scans that are due; return the time (ns) of the next one."""
        period_ns = 1e9 / (self._rate_hz * self._speed)
        due = int((now_ns - begun_ns) / period_ns)
        while self._sent < due:
            self._sent += 1
            time_ns = begun_ns + round(self._sent * period_ns)
            if scan := self._spoil(self._scan(time_ns)):
                self._hand_on(scan)
        return begun_ns + round((due + 1) * period_ns)

    def _hand_on(self, scan: bytes) -> None:
        import fcntl
        import termios

        waiting = int.from_bytes(fcntl.ioctl(self._file, termios.FIONREAD, bytes(4)), "little")
        if waiting >= self._length * len(scan):
            self.dropped += 1
            return
        if self._splits:
            self._splits -= 1
            os.write(self._file, self._held + scan[:5])
            self._held = scan[5:]
            return
        os.write(self._file, self._held + scan)
        self._held = b""

    def _measure(self, time_ns: int) -> tuple[int, ...]:
        felt = self.truth(time_ns)
        return tuple(
            round((value + self._random.gauss(0.0, self._noise)) / self.chip.scale)
            for value in felt
        )

    def _scan(self, time_ns: int) -> bytes:
        """Return a scan: elements aligned to their own size, the end to that of the largest."""
        if not (self._raw and self.stuck):
            self._raw = self._measure(time_ns)
        values = dict(zip(("in_accel_x", "in_accel_y", "in_accel_z"), self._raw, strict=True))
        ahead_ns = time.time_ns() - time.monotonic_ns() if self._realtime else 0
        stamp = self._random.getrandbits(62) if self._scrambled else time_ns + ahead_ns
        values |= {"in_temp": 1852, "in_timestamp": stamp}
        content = b""
        largest = 1
        for element in self._enabled:
            largest = max(largest, element.size)
            content += bytes(-len(content) % element.size) + pack(element, values[element.name])
        return content + bytes(-len(content) % largest)


def in_lab(world: "World", seed: int, clockwork: Clockwork) -> EmulatedIio:
    """Return an accelerometer of the virtual lab."""
    return EmulatedIio(
        world.acceleration_m_s2, ADXL359, clock_ppm=-120.0, seed=seed, clockwork=clockwork
    )


class VirtualIio(VirtualSensor):
    """Another accelerometer of the virtual lab; takes the options of ``iio-accelerometer`` too."""

    NAME, DRIVER, ADDRESS = "virtual-iio", "iio-accelerometer", "iio"
