"""One stream of a LabJack U6 for all drivers that read it.

A U6 runs one stream at a time and is opened once. A driver says what it wants as a `U6Reader`;
those that want the same U6 share its stream, and each is given the volts of its own inputs. The
stream ends with the last of them.
"""

import threading
import weakref
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from itertools import count
from typing import Any, Final

from mmt.core.errors import DeviceLost, InputError, MmtError
from mmt.devices.labjack.packets import (
    READ_CALIBRATION,
    STREAM_CONFIG,
    AnalogInput,
    plan,
    stream_config,
)
from mmt.devices.labjack.scans import BLOCKS, CentredLines, StreamDecoder, read_lines
from mmt.devices.labjack.usb_link import U6Link, check_alone, find_boxes
from mmt.devices.protocols import VoltageReading

INPUTS: Final = 14
MOST_SAMPLES_HZ: Final = 50_000
"""Largest rate of all channels together (the vendor's data sheet, section 3.2)."""

_MOST_WAITING: Final = 16_384
"""Scans for one driver; the oldest are dropped, and counted."""
_NUMBERS: Final = count()


class U6Reader:
    """What one driver wants of a U6, and what has come for it.

    Parameters
    ----------
    channels
        In the order of the volts.
    rate_hz
        Scans a second.
    box
        Serial number of the U6; None takes the only one.
    backend
        The pyusb backend; None takes the one that the system has.
    """

    def __init__(
        self, channels: Sequence[AnalogInput], rate_hz: float, box: int | None, backend: Any
    ) -> None:
        self.channels = tuple(channels)
        self.rate_hz = rate_hz
        self.box = box
        self.backend = backend
        self.faults: Counter[str] = Counter()
        """What befell the stream while it was read, see `StreamDecoder`."""
        self.waiting: deque[VoltageReading] = deque(maxlen=_MOST_WAITING)
        self.arrival_ns = 0
        """When the newest of them had come, by the host's monotonic clock."""
        self.number = next(_NUMBERS)
        """In the order in which the drivers were made."""
        _READERS.add(self)

    @property
    def terminals(self) -> set[int]:
        """The inputs that its channels take, a differential one two."""
        return terminals(self.channels)

    def give(self, scans: Sequence[VoltageReading], arrival_ns: int) -> None:
        """Keep scans until the driver reads them, the newest of which had come at that time."""
        self.arrival_ns = arrival_ns
        dropped = len(self.waiting) + len(scans) - _MOST_WAITING
        if dropped > 0:
            self.faults["lost scans"] += dropped
        self.waiting.extend(scans)


_READERS: Final[weakref.WeakSet[U6Reader]] = weakref.WeakSet()
"""The readers of all drivers that were made, also of those that are not connected yet."""
_OPEN: "Final[list[SharedU6]]" = []
_CONNECTING: Final = threading.Lock()
"""Held while a U6 is opened or closed, which takes long; reading does not wait for it."""


def connect(reader: U6Reader) -> "SharedU6":
    """Have the reader given its scans from now on, by a stream that runs already where it can.

    Raises
    ------
    InputError
        Its wishes and those of the drivers that read the same U6 cannot all be met.
    MmtError
        The U6 is not there, may not be opened, or refuses.
    """
    with _CONNECTING:
        if reader.box is None:
            check_alone(find_boxes(reader.backend))
        board = next((board for board in _OPEN if board.serves(reader)), None)
        board = board or SharedU6(reader.backend)
        board.admit(reader)
        if board not in _OPEN:
            _OPEN.append(board)
        return board


def disconnect(board: "SharedU6", reader: U6Reader) -> None:
    """Give the reader no more; the stream ends with its last reader."""
    with _CONNECTING:
        board.dismiss(reader)
        if not board.readers and board in _OPEN:
            _OPEN.remove(board)


class SharedU6:
    """A U6 that is open, and those who read it.

    Parameters
    ----------
    backend
        The pyusb backend.
    """

    def __init__(self, backend: Any) -> None:
        self.readers: tuple[U6Reader, ...] = ()
        self.serial = 0
        self._backend = backend
        self._link: U6Link | None = None
        self._decoder: StreamDecoder | None = None
        self._channels: tuple[AnalogInput, ...] = ()
        self._picks: list[tuple[U6Reader, tuple[int, ...] | None]] = []
        self._feeding = threading.Lock()

    def serves(self, reader: U6Reader) -> bool:
        """Return whether it is the U6 that the reader wants."""
        return self._backend is reader.backend and reader.box in {None, self.serial}

    def admit(self, reader: U6Reader) -> None:
        """Add a reader, and begin the stream where none runs that has its channels."""
        others = [other for other in self.readers if other is not reader]
        problem = conflict(reader, others)
        if problem:
            raise InputError(f"a LabJack U6 is shared by {len(others) + 1} drivers: {problem}")
        link = self._link
        if link is None or not link.flows or not set(reader.channels) <= set(self._channels):
            self._begin([*others, reader])
        reader.waiting.clear()
        self._route([*others, reader])

    def dismiss(self, reader: U6Reader) -> None:
        """Drop a reader; the stream ends with the last one."""
        self._route([other for other in self.readers if other is not reader])
        if not self.readers and self._link is not None:
            link, self._link = self._link, None
            link.close()

    def read(self, reader: U6Reader) -> list[VoltageReading]:
        """Return what has come for a reader, oldest first; never blocks.

        Raises
        ------
        DeviceLost
            The U6 was unplugged, which every reader is told.
        """
        waiting = reader.waiting
        with self._feeding:
            try:
                self._feed()
            except DeviceLost:
                if not waiting:
                    raise
            scans = list(waiting)
            waiting.clear()
        return scans

    def _feed(self) -> None:
        """Decode what has come, and give each reader its columns."""
        link, decoder = self._link, self._decoder
        if link is None or decoder is None:
            return
        packets = link.packets()
        if not packets:
            return
        scans = [scan for _, raw in packets for scan in decoder.decode(raw)]
        for reader, columns in self._picks:
            if decoder.faults:
                reader.faults.update(decoder.faults)
            if not scans:
                continue
            of_reader = scans
            if columns is not None:
                of_reader = [
                    VoltageReading(t, tuple([volts[at] for at in columns])) for t, volts in scans
                ]
            reader.give(of_reader, packets[-1][0])
        decoder.faults.clear()

    def _begin(self, readers: Sequence[U6Reader]) -> None:
        """Open the U6 again and start a stream for these readers.

        Drivers that were made for it and are not connected yet have their channels in it as
        well, where they fit: when they connect, no stream is interrupted.
        """
        with self._feeding:
            old, self._link = self._link, None  # until then nothing comes, which is no loss
        if old is not None:
            old.close()
        named = [reader.box for reader in readers if reader.box is not None]
        link = U6Link(named[0] if named else None, self._backend)
        try:
            link.open()
            chosen = _with_those_to_come(readers, self._backend, link.serial)
            channels = tuple(dict.fromkeys(c for reader in chosen for c in reader.channels))
            scanning = plan(channels, readers[0].rate_hz)
            decoder = StreamDecoder(scanning, _calibration(link))
            link.send(stream_config(scanning), STREAM_CONFIG)
            link.start()
        except BaseException:
            link.close()
            with self._feeding:
                self._link = link  # it is closed: its readers are told that the U6 is lost
            raise
        with self._feeding:
            self.serial = link.serial
            self._channels, self._link, self._decoder = channels, link, decoder
        self._route(self.readers)

    def _route(self, readers: Sequence[U6Reader]) -> None:
        with self._feeding:
            self.readers = tuple(readers)
            self._picks = [(each, self._columns(each)) for each in readers]

    def _columns(self, reader: U6Reader) -> tuple[int, ...] | None:
        """Return where a reader's channels are in a scan, None where they are the scan."""
        if reader.channels == self._channels:
            return None
        return tuple(self._channels.index(channel) for channel in reader.channels)


def terminals(channels: Iterable[AnalogInput]) -> set[int]:
    """Return the inputs that channels take, a differential one two."""
    return {c.number + half for c in channels for half in range(1 + c.differential)}


def conflict(reader: U6Reader, others: Sequence[U6Reader]) -> str:
    """Return why one stream cannot serve a reader beside others, empty where it can."""
    taken: set[int] = set()
    for other in others:
        taken |= other.terminals
        if other.rate_hz != reader.rate_hz:
            return (
                f"one asks for {reader.rate_hz:g} scans a second, another for {other.rate_hz:g}, "
                "and it has one clock: give them the same rate_hz"
            )
    free = set(range(INPUTS)) - taken
    if len(free) < len(reader.terminals):
        return (
            f"the others take {len(taken)} of its {INPUTS} inputs (a differential one takes "
            f"two), so that {len(reader.terminals)} more do not fit: measure single-ended"
        )
    twice = sorted(reader.terminals & taken)
    if twice:
        return (
            f"input {_listed(twice)} belongs to another driver already: choose from "
            f"{_listed(sorted(free))}"
        )
    samples_hz = reader.rate_hz * sum(len(each.channels) for each in [reader, *others])
    if samples_hz > MOST_SAMPLES_HZ:
        return (
            f"{samples_hz:.0f} samples a second are more than its {MOST_SAMPLES_HZ}: lower "
            "rate_hz of each"
        )
    return ""


def _with_those_to_come(readers: Sequence[U6Reader], backend: Any, serial: int) -> list[U6Reader]:
    chosen = sorted(readers, key=lambda reader: reader.number)
    for other in sorted(_READERS, key=lambda reader: reader.number):
        same = other.backend is backend and other.box in {None, serial}
        if same and other not in chosen and not conflict(other, chosen):
            chosen.append(other)
    return chosen


def _calibration(link: U6Link) -> tuple[CentredLines, ...]:
    blocks = [link.ask(READ_CALIBRATION, bytes((0, number))) for number in range(BLOCKS)]
    try:
        return read_lines(blocks)
    except ValueError as error:
        raise MmtError(f"the LabJack U6 is not calibrated: {error}") from error


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))
