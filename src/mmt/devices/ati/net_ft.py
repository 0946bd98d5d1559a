"""Force through ATI's Net F/T box: settings by HTTP, records by UDP with the kernel's stamps."""

import contextlib
import socket
import struct
import sys
import time
from collections.abc import Callable
from typing import Final

from pydantic import Field

from mmt.core.errors import DeviceLost, MmtError
from mmt.devices.ati.calibration import AtiOptions, check_calibration
from mmt.devices.ati.net_wire import (
    PORT,
    RDT_ERROR,
    RECORD,
    RESET_LATCH,
    SATURATED,
    START,
    STOP,
    NetPages,
    NetSettings,
    explain_status,
    filter_delay_ns,
    is_broken,
    request,
)
from mmt.devices.record_clocks import SequenceClock
from mmt.devices.sensor_drivers import Stamped, WrenchSensor

_SO_TIMESTAMPNS: Final = 35
"""Number of the option on 64-bit Linux; `socket` does not name it. The kernel starts stamping some
milliseconds later: until then the stamp is the time at which the packet is read."""
_STAMP: Final = struct.Struct("qq")
"""Seconds and nanoseconds of the wall clock."""
_ROOM: Final = 64
_STAMPED_OF: Final = 8
"""One look in this many reads the stamps: enough to estimate a clock. Such a look takes
twice as long."""


class StampedSocket:
    """Receives packets into a buffer, without waiting, some with their arrival time.

    The kernel's stamp is the true arrival time even if the program was busy with something else.

    Parameters
    ----------
    udp
        A socket that does not block; the caller closes it.
    """

    def __init__(self, udp: socket.socket) -> None:
        self._udp = udp
        self._stamp = b""
        self._stamps = False
        self._looks = 0
        if sys.platform == "linux" and struct.calcsize("P") == 8:
            with contextlib.suppress(OSError):
                udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
                self._stamps = True

    def receiver(self) -> Callable[[bytearray], int]:
        """Return the function that receives the waiting packets, one in each call.

        The function takes a buffer and returns the packet's length. It raises `BlockingIOError`
        if no packet waits, and another `OSError` if the network reports an error.
        """
        self._stamp = b""
        self._looks = (self._looks + 1) % _STAMPED_OF
        return self._receive_stamped if self._stamps and not self._looks else self._udp.recv_into

    def _receive_stamped(self, buffer: bytearray) -> int:
        size, ancillary, _, _ = self._udp.recvmsg_into((buffer,), _ROOM)
        self._stamp = ancillary[0][2] if ancillary else b""
        return size

    def arrival_ns(self, earliest_ns: int) -> int:
        """Return the arrival time (ns, monotonic clock) of the last look's newest packet.

        Parameters
        ----------
        earliest_ns
            A time before the packet came; an earlier stamp, as after the wall clock was set, is
            ignored. Without a usable stamp the time of this call is returned.
        """
        if len(self._stamp) != _STAMP.size:
            return time.monotonic_ns()
        wall_ns = time.time_ns()
        now_ns = time.monotonic_ns()  # after it: a pause in between must not make the arrival early
        seconds, nanoseconds = _STAMP.unpack(self._stamp)
        arrival_ns = now_ns - (wall_ns - 1_000_000_000 * int(seconds) - int(nanoseconds))
        return arrival_ns if earliest_ns <= arrival_ns <= now_ns else now_ns


_MOST_RECORDS: Final = 1024
"""Records read in one call at most."""
_REPEAT_START_NS: Final = 50_000_000
_RECEIVE_BUFFER: Final = 1 << 20


class NetFtOptions(AtiOptions):
    """Options of ``ati-net-ft``."""

    host: str = "192.168.1.1"
    """Address of the box."""
    rate_hz: int = Field(default=2000, ge=1, le=7000)
    """Records a second; the box may round up to 7000 / n."""
    filter: int = Field(default=2, ge=0, le=12)
    """Low-pass filter of the box: 0 none, 1 to 8 for 838 to 5 Hz, 9 to 12 for 1500 to 3000 Hz."""
    rdt_port: int = Field(default=PORT, ge=1, le=65535)
    http_port: int = Field(default=80, ge=1, le=65535)


class NetFt(WrenchSensor):
    """A `SampledSensor` of forces behind a Net F/T box."""

    OPTIONS = NetFtOptions

    def __init__(self, options: NetFtOptions) -> None:
        super().__init__(f"Net F/T at {options.host}", options)
        self._options = options
        self._pages = NetPages(options.host, options.http_port, self.name)
        self._socket: socket.socket | None = None
        self._packets: StampedSocket | None = None
        self._clock: SequenceClock | None = None
        self._bias_in_box: str | None = None
        self._started_ns = 0  # when records were asked for, 0 before
        self._heard_ns = 0  # when a record came, usable or not
        self._broken_status = 0  # of the newest record that was not usable
        self._looked_ns = 0
        self.arrival_ns = 0
        """Arrival time of the newest record (ns, host's monotonic clock)."""
        self._buffer = bytearray(2048)
        self.settings: NetSettings | None = None
        """Settings that the box reports; None until it is connected."""

    def _open(self) -> None:
        """Read, check and set the box's settings, then open the socket."""
        settings = self._settle()
        self.settings = settings
        self._set_matrix(settings.calibration.matrix, settings.calibration.limits)
        self._set_latency(filter_delay_ns(settings.filter))
        if self._clock is None or self._clock.period_ns != 1e9 / settings.rate_hz:
            self._clock = SequenceClock(settings.rate_hz, self._counts)
        else:
            self._clock.interrupt()
        self._open_socket()
        self._started_ns = self._broken_status = 0

    def calibrate(self) -> None:
        """Take the bias; see `WrenchSensor.calibrate`."""
        super().calibrate()
        if self.settings is not None:
            self._bias_in_box = self.settings.bias

    def close(self) -> None:
        """Stop the stream and close the socket; calling it twice is harmless."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.send(request(STOP))
            self._socket.close()
            self._socket = self._packets = None

    def _settle(self) -> NetSettings:
        """Set the box as the options ask and return its resulting settings."""
        pages, options = self._pages, self._options
        settings = pages.settings()
        check_calibration(self.name, settings.calibration, options)
        changed = False
        if settings.rate_hz != options.rate_hz:
            pages.set_rate(options.rate_hz)
            changed = True
        if settings.filter != options.filter:
            pages.set_filter(options.filter)
            changed = True
        if self._bias_in_box not in {None, settings.bias}:
            pages.set_bias(str(self._bias_in_box))
            self._counts["bias restored in the box"] += 1
            changed = True
        if not changed:
            return settings
        settings = pages.settings()
        if settings.filter != options.filter:
            raise MmtError(
                f"{self.name}: the box keeps filter {settings.filter}, asked for was "
                f"{options.filter}; choose one that its Settings page offers"
            )
        if settings.rate_hz < options.rate_hz:
            raise MmtError(
                f"{self.name}: the box keeps {settings.rate_hz:g} records a second, asked for "
                f"were {options.rate_hz}; set the rate on its Communications page"
            )
        return settings

    def _open_socket(self) -> None:
        options = self._options
        try:
            address = socket.getaddrinfo(
                options.host, options.rdt_port, socket.AF_INET, socket.SOCK_DGRAM
            )[0][4]
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            self._socket.setblocking(False)
            self._packets = StampedSocket(self._socket)
            self._socket.connect(address)
            self._socket.send(request(RESET_LATCH))
        except OSError as error:
            raise MmtError(
                f"{self.name}: UDP port {options.rdt_port} cannot be reached ({error}); check "
                "'host' and this machine's network"
            ) from error

    def _explain_absence(self) -> str:
        if self._broken_status:
            return self._explain_unusable()
        return (
            f"{self.name}: its web page answers, but no record comes to UDP port "
            f"{self._options.rdt_port}; {self._where()}"
        )

    def _where(self) -> str:
        return (
            "check the box's power and network cable, and that no firewall here keeps out UDP "
            f"from port {self._options.rdt_port}"
        )

    def _receive(self, now_ns: int) -> list[Stamped]:
        udp, packets, clock = self._socket, self._packets, self._clock
        if udp is None or packets is None or clock is None:
            raise DeviceLost(f"{self.name} is closed: connect it again")
        if not self._started_ns:
            self._ask(udp, now_ns)
        buffer = self._buffer
        records: list[Stamped] = []
        receive_into, unpack, stamp = packets.receiver(), RECORD.unpack_from, clock.stamp
        try:
            for _ in range(_MOST_RECORDS):
                if receive_into(buffer) != RECORD.size:
                    self._counts["packet that is no record"] += 1
                    continue
                self._heard_ns = now_ns
                sequence, _measurement, status, a, b, c, d, e, f = unpack(buffer)
                time_ns = stamp(sequence & 0xFFFFFFFF, now_ns)
                if time_ns is None or (status and not self._is_usable(status & 0xFFFFFFFF, now_ns)):
                    continue
                records.append((time_ns, (a, b, c, d, e, f)))
        except BlockingIOError:
            pass
        except OSError as error:
            raise DeviceLost(
                f"{self.name}: the network reports {error.strerror or error}; {self._where()}"
            ) from error
        looked_ns, self._looked_ns = self._looked_ns, now_ns
        if records:
            self.arrival_ns = packets.arrival_ns(looked_ns)
        elif now_ns - max(self._heard_ns, self._started_ns) > _REPEAT_START_NS:
            self._counts["start request repeated"] += 1
            clock.interrupt()
            self._ask(udp, now_ns)
        return records

    def _ask(self, udp: socket.socket, now_ns: int) -> None:
        """Ask for records; the caller repeats this, since request or answer can be lost."""
        self._started_ns = now_ns
        with contextlib.suppress(OSError):  # the silence that follows is reported
            udp.send(request(START))

    def _is_usable(self, status: int, now_ns: int) -> bool:
        if status & SATURATED:
            self._saturate()
        if not is_broken(status):
            return True
        self._counts["RDT error" if status & RDT_ERROR else "error status"] += 1
        self._broken_status, self._useless_ns = status, now_ns
        return False

    def _explain_unusable(self) -> str:
        return (
            f"{self.name}: the box reports {explain_status(self._broken_status)}: check the "
            "transducer's cable and the box's System Information page, and switch it off and on"
        )
