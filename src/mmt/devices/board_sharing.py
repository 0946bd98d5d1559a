"""One stream of an acquisition board for all drivers that read it.

A board runs one stream at a time and is opened once. Drivers of the same board share its stream,
each through a `SharedInputs` that gets the volts of its own inputs. The stream ends when the last
driver closes.
"""

import threading
import weakref
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Hashable, Sequence
from itertools import count
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar

from mmt.core.errors import DeviceLost, InputError
from mmt.devices.protocols import VoltageReading

Channel = TypeVar("Channel", bound=Hashable)
ChannelsOf = Callable[[int | str], tuple[Channel, ...]]
"""Returns the channels to stream, given the identifier of the opened board."""

_MOST_WAITING: Final = 16_384
"""Scans buffered for one driver; beyond that the oldest are dropped and counted."""
_NUMBERS: Final = count()


class StreamData(NamedTuple):
    """Data received from a stream."""

    scans: list[VoltageReading]
    """Oldest first, with the volts of every channel."""
    arrival_ns: int
    """Arrival time of the newest scan (ns, host's monotonic clock)."""
    faults: Counter[str]
    """Faults of the stream meanwhile."""


class BoardStream(Protocol):
    """The stream of an open board."""

    serial: str
    """Name of the board, under which calibrations of its sensors are stored."""

    @property
    def board(self) -> int | str:
        """Identifier of the board."""

    @property
    def is_streaming(self) -> bool:
        """Whether scans are still arriving."""

    def read_scans(self) -> StreamData:
        """Return the data received since the last call; never blocks.

        Raises
        ------
        DeviceLost
            No data has arrived, and none will.
        """

    def close(self) -> None:
        """End the stream and release the board; calling it twice is harmless."""


class SharedInputs(ABC, Generic[Channel]):
    """A `VoltageBoard` that streams inputs at an even rate, and may share its board.

    Parameters
    ----------
    channels
        Channels in the order of the volts.
    rate_hz
        Scans a second.
    limit_v
        Largest magnitude that every input measures.
    board
        Identifier of the board; None takes the only one.
    backend
        Library through which the board is reached.
    """

    what: str
    """Name of this kind of board in messages."""
    latency_ns = 0
    """0: a scan is stamped at its start; its inputs are sampled one after another."""

    def __init__(
        self,
        channels: Sequence[Channel],
        rate_hz: float,
        limit_v: float,
        board: int | str | None,
        backend: Any,
    ) -> None:
        self.channels = tuple(channels)
        self.inputs = len(self.channels)
        """How many voltages a reading has."""
        self.rate_hz = rate_hz
        self.limit_v = limit_v
        self.board = board
        self.backend = backend
        self.arrival_ns = 0
        """Arrival time of the newest scan (ns, host's monotonic clock)."""
        self.number = next(_NUMBERS)
        """Rank in the order of creation."""
        self._faults: Counter[str] = Counter()
        self._waiting: deque[VoltageReading] = deque(maxlen=_MOST_WAITING)
        self._shared: SharedBoard[Channel] | None = None
        self._admitted = False
        _MADE.add(self)

    @abstractmethod
    def open_stream(self, channels_of: ChannelsOf[Channel]) -> BoardStream:
        """Open the board, and start a stream of the channels that `channels_of` returns for it.

        Raises
        ------
        MmtError
            The board is missing, may not be opened, or refuses a command.
        """

    @abstractmethod
    def require_one(self) -> None:
        """Raise if several boards are connected, since the options name none."""

    @abstractmethod
    def conflict_with(self, others: "Sequence[SharedInputs[Channel]]") -> str:
        """Return why one stream cannot hold these channels and the others', or ''."""

    @property
    def serial(self) -> str:
        """Name of the connected board, as ``u6-360000001``, or ''."""
        stream = None if self._shared is None else self._shared.stream
        return "" if stream is None else stream.serial

    @property
    def faults(self) -> Counter[str]:
        """Counts of the stream's faults by kind, including ``lost scans``."""
        return Counter(self._faults)  # a copy, since another driver's thread may add to it

    def connect(self) -> None:
        """Open the board and start its stream, or join one that runs.

        Raises
        ------
        InputError
            Another driver reads the same board with incompatible settings.
        MmtError
            The board is missing, may not be opened, or refuses a command.
        """
        self._leave()
        self._waiting.clear()
        with _CONNECTING:
            if self.board is None:
                self.require_one()
            shared = (
                next((each for each in OPEN_BOARDS if each.serves(self)), None) or SharedBoard()
            )
            if not self._admitted:
                _MADE.discard(self)  # if it is refused, others' streams do without its channels
            shared.admit(self)
            _MADE.add(self)
            self._shared, self._admitted = shared, True
            if shared not in OPEN_BOARDS:
                OPEN_BOARDS.append(shared)

    def read(self) -> list[VoltageReading]:
        """Return the new scans, oldest first, by the board's clock; never blocks.

        Raises
        ------
        DeviceLost
            The board was unplugged, or is not open.
        """
        if self._shared is None:
            raise DeviceLost(f"the {self.what} is not open: connect it again")
        return self._shared.read(self, self._waiting)

    def close(self) -> None:
        """Release the board; its stream ends with its last reader. Calling it twice is harmless."""
        self._leave()

    def _leave(self) -> None:
        shared, self._shared = self._shared, None
        if shared is not None:
            with _CONNECTING:
                shared.dismiss(self)
                if not shared.readers and shared in OPEN_BOARDS:
                    OPEN_BOARDS.remove(shared)

    def buffer_scans(self, arrived: StreamData, scans: Sequence[VoltageReading]) -> None:
        """Buffer this driver's part of the received scans until `read`."""
        self._faults.update(arrived.faults)
        if scans:
            self.arrival_ns = arrived.arrival_ns
            dropped = len(self._waiting) + len(scans) - _MOST_WAITING
            if dropped > 0:
                self._faults["lost scans"] += dropped
            self._waiting.extend(scans)

    def find_conflict(self, others: "Sequence[SharedInputs[Channel]]") -> str:
        """Return why one stream cannot serve this driver and the others, or ''."""
        for other in others:
            if other.rate_hz != self.rate_hz:
                return (
                    f"one asks for {self.rate_hz:g} scans a second, another for "
                    f"{other.rate_hz:g}, and it has one clock: give them the same rate_hz"
                )
        return self.conflict_with(others)

    def same_kind(self, other: "SharedInputs[Any]") -> bool:
        """Return whether another driver has the same kind of board and the same backend."""
        return type(other) is type(self) and other.backend is self.backend


_MADE: "Final[weakref.WeakSet[SharedInputs[Any]]]" = weakref.WeakSet()
"""The `SharedInputs` of all drivers, connected or not."""
OPEN_BOARDS: "Final[list[SharedBoard[Any]]]" = []
_CONNECTING: Final = threading.Lock()
"""Held while a board is opened or closed, which takes long; `read` does not need it."""


class SharedBoard(Generic[Channel]):
    """An open board and its readers."""

    def __init__(self) -> None:
        self.readers: tuple[SharedInputs[Channel], ...] = ()
        self.stream: BoardStream | None = None
        self._board: int | str | None = None
        self._channels: tuple[Channel, ...] = ()
        self._picks: list[tuple[SharedInputs[Channel], tuple[int, ...] | None]] = []
        self._feeding = threading.Lock()
        self._gone = False

    def serves(self, reader: SharedInputs[Channel]) -> bool:
        """Return whether this is the board that the reader wants."""
        return self.readers[0].same_kind(reader) and reader.board in {None, self._board}

    def admit(self, reader: SharedInputs[Channel]) -> None:
        """Add a reader, and restart the stream unless the running one has the reader's channels."""
        others = [other for other in self.readers if other is not reader]
        if problem := reader.find_conflict(others):
            shared = f" is shared by {len(others) + 1} drivers" if others else ""
            raise InputError(f"a {reader.what}{shared}: {problem}")
        stream = self.stream
        if (
            stream is None
            or not stream.is_streaming
            or not set(reader.channels) <= set(self._channels)
        ):
            self._begin([*others, reader])
        self._route([*others, reader])

    def dismiss(self, reader: SharedInputs[Channel]) -> None:
        """Drop a reader; the stream ends with the last one."""
        self._route([other for other in self.readers if other is not reader])
        if not self.readers and self.stream is not None:
            stream, self.stream = self.stream, None
            stream.close()

    def read(
        self, reader: SharedInputs[Channel], waiting: deque[VoltageReading]
    ) -> list[VoltageReading]:
        """Return a reader's new scans, oldest first; never blocks.

        Raises
        ------
        DeviceLost
            The board was unplugged; every reader gets this error.
        """
        with self._feeding:
            try:
                self._feed(reader.what)
            except DeviceLost:
                if not waiting:
                    raise
            scans = list(waiting)
            waiting.clear()
        return scans

    def _feed(self, what: str) -> None:
        """Give each reader its columns of the new scans."""
        if self._gone:
            raise DeviceLost(f"the {what} is gone: plug it in again")
        if self.stream is None:
            return
        arrived = self.stream.read_scans()
        for reader, columns in self._picks:
            scans = arrived.scans
            if columns is not None:
                scans = [
                    VoltageReading(t, tuple([volts[at] for at in columns])) for t, volts in scans
                ]
            reader.buffer_scans(arrived, scans)

    def _begin(self, readers: Sequence[SharedInputs[Channel]]) -> None:
        """Open the board again and start a stream for these readers.

        The stream includes, if they fit, the channels of drivers that are not connected yet:
        their `connect` then interrupts no stream.
        """
        with self._feeding:
            old, self.stream = self.stream, None  # `read` returns nothing meanwhile
            self._gone = False
        if old is not None:
            old.close()
        chosen: tuple[Channel, ...] = ()

        def channels_of(board: int | str) -> tuple[Channel, ...]:
            nonlocal chosen
            together = _with_those_to_come(readers, board)
            chosen = tuple(dict.fromkeys(c for reader in together for c in reader.channels))
            return chosen

        named = next((each for each in readers if each.board is not None), readers[0])
        try:
            stream = named.open_stream(channels_of)
        except BaseException:
            self._gone = True  # its readers are told that the board is lost
            raise
        with self._feeding:
            self._channels, self._board, self.stream = chosen, stream.board, stream

    def _route(self, readers: Sequence[SharedInputs[Channel]]) -> None:
        with self._feeding:
            self.readers = tuple(readers)
            self._picks = [(each, self._columns(each)) for each in readers]

    def _columns(self, reader: SharedInputs[Channel]) -> tuple[int, ...] | None:
        """Return the columns of a reader's channels in a scan, or None if they are all of it."""
        if reader.channels == self._channels:
            return None
        return tuple(self._channels.index(channel) for channel in reader.channels)


def _with_those_to_come(
    readers: Sequence[SharedInputs[Channel]], board: int | str
) -> list[SharedInputs[Channel]]:
    chosen = sorted(readers, key=lambda reader: reader.number)
    for other in sorted(_MADE, key=lambda reader: reader.number):
        same = other.same_kind(readers[0]) and other.board in {None, board}
        if same and other not in chosen and not other.find_conflict(chosen):
            chosen.append(other)
    return chosen
