"""A LabJack U6 on USB: find it, command it, and receive its stream in a thread."""

import contextlib
import errno
import threading
import time
from array import array
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, Final

import usb.core
import usb.util

from mmt.core.errors import DeviceLost, MmtError
from mmt.core.running.process import follow_real_time
from mmt.devices.board_sharing import ChannelsOf, StreamData
from mmt.devices.discovery import NO_LIBUSB
from mmt.devices.labjack.packets import (
    CONFIG_U6,
    READ_CALIBRATION,
    START_STREAM,
    STOP_STREAM,
    STREAM_CONFIG,
    AnalogInput,
    command,
    explain,
    plan,
    read_reply,
    read_short_reply,
    stream_config,
)
from mmt.devices.labjack.scans import BLOCKS, CentredLines, StreamDecoder, read_lines

VENDOR: Final = 0x0CD5
PRODUCT: Final = 0x0006

_OUT: Final = 0x01
_REPLIES: Final = 0x82
_STREAM: Final = 0x83
_REPLY_MS: Final = 1000
_DRAIN_MS: Final = 20
_STREAM_MS: Final = 100
_PACKET: Final = 64
_SILENT_NS: Final = 200_000_000
_MOST_WAITING: Final = 8192
"""Packets in the buffer; beyond that the oldest are dropped, and a gap in the numbers shows it."""


class U6Stream:
    """A `BoardStream` of a LabJack U6.

    Parameters
    ----------
    box
        Serial number of the U6; None takes the only one.
    backend
        The pyusb backend; None takes the one that the system has.
    rate_hz
        Scans a second.
    channels_of
        Returns the inputs to scan.

    Raises
    ------
    MmtError
        No U6 or several are connected, or the U6 may not be opened, does not answer, or refuses a
        command.
    """

    def __init__(
        self, box: int | None, backend: Any, rate_hz: float, channels_of: ChannelsOf[AnalogInput]
    ) -> None:
        self._device: Any = None
        self._thread: threading.Thread | None = None
        self._ending = threading.Event()
        self._lost = threading.Event()
        self._packets: deque[tuple[int, bytes]] = deque(maxlen=_MOST_WAITING)
        """Arrival time of each packet (ns, host's monotonic clock), and the packet."""
        try:
            self.board = self._open(box, backend)
            self.serial = f"u6-{self.board}"
            scanning = plan(channels_of(self.board), rate_hz)
            self._decoder = StreamDecoder(scanning, self._calibration())
            self._send(stream_config(scanning), STREAM_CONFIG)
            self._start()
        except BaseException:
            self.close()
            raise

    def _open(self, wanted: int | None, backend: Any) -> int:
        """Find the U6, end a stream that a program left behind, and return its serial number."""
        found = find_boxes(backend)
        if wanted is None:
            check_alone(found)
        told = []
        for device in found:
            self._device = device
            try:
                number = self._open_box()
            except MmtError as error:  # perhaps another program's, and not the wanted one
                if wanted is None:
                    raise
                told.append(f"the serial number of one cannot be read: {error}")
                continue
            if wanted in {None, number}:
                return number
            told.append(f"there is {number}")
            self._release()
        which = "" if wanted is None else f" with serial number {wanted}"
        raise MmtError("; ".join([f"there is no LabJack U6{which} on USB: plug it in", *told]))

    def _calibration(self) -> tuple[CentredLines, ...]:
        blocks = [
            self._send(command(READ_CALIBRATION, bytes((0, number))), READ_CALIBRATION)
            for number in range(BLOCKS)
        ]
        try:
            return read_lines(blocks)
        except ValueError as error:
            raise MmtError(f"the LabJack U6 is not calibrated: {error}") from error

    def _send(self, packet: bytes, number: int) -> bytes:
        """Send an encoded extended command and return the content of its reply."""
        try:
            return read_reply(self._exchange(packet), number)
        except ValueError as error:
            raise MmtError(f"a command to the LabJack U6 failed: {error}") from error

    def _start(self) -> None:
        """Start the stream that was configured."""
        error = self._short(START_STREAM)
        if error:
            raise MmtError(f"the LabJack U6 does not stream: {explain(error)}")
        self._heard_ns = time.monotonic_ns()
        self._thread = threading.Thread(
            target=self._run, args=(self._device,), name="LabJack U6", daemon=True
        )
        self._thread.start()

    @property
    def is_streaming(self) -> bool:
        """Whether the stream's packets are still arriving."""
        silent_ns = time.monotonic_ns() - self._heard_ns
        return self._thread is not None and not self._lost.is_set() and silent_ns < _SILENT_NS

    def read_scans(self) -> StreamData:
        """Decode the received packets; see `BoardStream`."""
        waiting, decoder = self._packets, self._decoder
        packets = [waiting.popleft() for _ in range(len(waiting))]
        if not packets and (self._lost.is_set() or self._device is None):
            raise DeviceLost("the LabJack U6 is gone: plug it in again")
        scans = [scan for _, raw in packets for scan in decoder.decode(raw)]
        faults, decoder.faults = decoder.faults, Counter()
        return StreamData(scans, packets[-1][0] if packets else 0, faults)

    def close(self) -> None:
        """End the stream and release the U6; calling it twice is harmless."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
            self._thread = None
        if self._device is not None:
            with contextlib.suppress(MmtError):
                self._short(STOP_STREAM)
            self._release()

    def _run(self, device: Any) -> None:
        follow_real_time()
        buffer = array("B", bytes(_PACKET))
        while not self._ending.is_set():
            try:
                size = device.read(_STREAM, buffer, _STREAM_MS)
            except usb.core.USBTimeoutError:
                continue
            except usb.core.USBError:
                self._lost.set()
                return
            self._heard_ns = arrival_ns = time.monotonic_ns()
            self._packets.append((arrival_ns, buffer[:size].tobytes()))

    def _open_box(self) -> int:
        """End a running stream, discard waiting packets, and return the serial number."""
        try:
            try:
                self._device.get_active_configuration()
            except usb.core.USBError:
                self._device.set_configuration()
            self._device.write(_OUT, STOP_STREAM, _REPLY_MS)
            for endpoint in (_REPLIES, _STREAM):
                with contextlib.suppress(usb.core.USBTimeoutError):
                    for _ in range(_MOST_WAITING):  # it may go on sending
                        self._device.read(endpoint, _PACKET, _DRAIN_MS)
            reply = self._send(command(CONFIG_U6, bytes(20)), CONFIG_U6)
        except usb.core.USBError as error:
            self._release()
            raise MmtError(_reason(error)) from error
        except MmtError:
            self._release()
            raise
        return int.from_bytes(reply[7:11], "little")

    def _short(self, packet: bytes) -> int:
        try:
            return read_short_reply(self._exchange(packet), packet)
        except ValueError as error:
            raise MmtError(f"a command to the LabJack U6 failed: {error}") from error

    def _exchange(self, packet: bytes) -> bytes:
        try:
            self._device.write(_OUT, packet, _REPLY_MS)
            return bytes(self._device.read(_REPLIES, _PACKET, _REPLY_MS))
        except usb.core.USBError as error:
            raise MmtError(_reason(error)) from error

    def _release(self) -> None:
        device, self._device = self._device, None
        if device is not None:
            with contextlib.suppress(usb.core.USBError):
                usb.util.dispose_resources(device)


def find_boxes(backend: Any) -> list[Any]:
    """Return every U6 on USB, as pyusb's devices; none is opened.

    Raises
    ------
    MmtError
        USB cannot be searched.
    """
    try:
        return list(
            usb.core.find(find_all=True, idVendor=VENDOR, idProduct=PRODUCT, backend=backend)
        )
    except usb.core.NoBackendError as error:
        raise MmtError(f"the LabJack U6 cannot be reached: {NO_LIBUSB}") from error


def check_alone(found: Sequence[Any]) -> None:
    """Refuse several boxes, since the options name none.

    Raises
    ------
    MmtError
        There are several.
    """
    if len(found) > 1:
        raise MmtError(f"there are {len(found)} LabJack U6: say which one by the option 'box'")


def _reason(error: usb.core.USBError) -> str:
    if error.errno == errno.EACCES:
        return (
            "the LabJack U6 may not be opened. On Linux add the udev rule "
            'SUBSYSTEM=="usb", ATTR{idVendor}=="0cd5", MODE="0666" as '
            "/etc/udev/rules.d/90-labjack.rules, then unplug it and plug it in"
        )
    if error.errno == errno.EBUSY:
        return "another program has the LabJack U6 open: close that one"
    if isinstance(error, usb.core.USBTimeoutError):
        return "the LabJack U6 does not answer: unplug it and plug it in again"
    return f"the LabJack U6 is gone ({error.strerror or error}): plug it in again"
