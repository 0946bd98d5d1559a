"""One stream of an acquisition board for all drivers that read it.

A board runs one stream at a time and is opened once. Each driver has a `SharedInputs`; those that
want the same board share its stream, and each is given the volts of its own inputs. The stream
ends with the last of them.
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
"""Given which board was opened, returns the channels that its stream is to have."""

_MOST_WAITING: Final = 16_384
"""Scans for one driver; the oldest are dropped, and counted."""
_NUMBERS: Final = count()


class Arrived(NamedTuple):
    """What has come of a stream."""

    scans: list[VoltageReading]
    """Oldest first, with the volts of every channel."""
    arrival_ns: int
    """When the newest had come, by the host's monotonic clock."""
    faults: Counter[str]
    """What befell the stream meanwhile."""


class BoardStream(Protocol):
    """The stream of a board that is open."""

    serial: str
    """Under which a calibration of what is wired to it is stored."""

    @property
    def board(self) -> int | str:
        """Which board it is."""

    @property
    def flows(self) -> bool:
        """Whether scans have been coming until now."""

    def take(self) -> Arrived:
        """Return what has come; never blocks.

        Raises
        ------
        DeviceLost
            Nothing has come, and nothing will.
        """

    def close(self) -> None:
        """End it and let the board go; calling it twice is harmless."""


class SharedInputs(ABC, Generic[Channel]):
    """A `VoltageBoard` that streams inputs at an even rate, also beside others of one board.

    Parameters
    ----------
    channels
        In the order of the volts.
    rate_hz
        Scans a second.
    limit_v
        Largest magnitude that every input measures.
    board
        Which one; None takes the only one.
    backend
        By which it is reached.
    """

    what: str
    """What a person calls such a board."""
    latency_ns = 0
    """A scan is stamped when it begins; its inputs follow each other within it."""

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
        """When the newest scan that `read` has returned had come, by the host's clock."""
        self.number = next(_NUMBERS)
        """In the order in which they were made."""
        self._faults: Counter[str] = Counter()
        self._waiting: deque[VoltageReading] = deque(maxlen=_MOST_WAITING)
        self._shared: SharedBoard[Channel] | None = None
        _MADE.add(self)

    @abstractmethod
    def open_stream(self, channels_of: ChannelsOf[Channel]) -> BoardStream:
        """Open the board, and start a stream of the channels that are to be had of it.

        Raises
        ------
        MmtError
            It is not there, may not be opened, or refuses.
        """

    @abstractmethod
    def require_one(self) -> None:
        """Raise where several boards are there and none is named."""

    @abstractmethod
    def misfit(self, others: "Sequence[SharedInputs[Channel]]") -> str:
        """Return why one stream of this rate cannot have its channels beside others', or ''."""

    @property
    def serial(self) -> str:
        """Names the board that is connected, as ``u6-360000001``."""
        stream = None if self._shared is None else self._shared.stream
        return "" if stream is None else stream.serial

    @property
    def faults(self) -> Counter[str]:
        """What befell the stream while it was read, ``lost scans`` among it."""
        return Counter(self._faults)  # which another driver's thread may be adding to

    def connect(self) -> None:
        """Open the board and start its stream, or join one that runs.

        Raises
        ------
        InputError
            Another driver reads the same board with settings that do not go with these.
        MmtError
            It is not there, may not be opened, or refuses.
        """
        self._leave()
        self._waiting.clear()
        with _CONNECTING:
            if self.board is None:
                self.require_one()
            shared = (
                next((each for each in OPEN_BOARDS if each.serves(self)), None) or SharedBoard()
            )
            shared.admit(self)
            self._shared = shared
            if shared not in OPEN_BOARDS:
                OPEN_BOARDS.append(shared)

    def read(self) -> list[VoltageReading]:
        """Return what has come, oldest first, by the board's clock; never blocks.

        Raises
        ------
        DeviceLost
            It was unplugged, or is not open.
        """
        if self._shared is None:
            raise DeviceLost(f"the {self.what} is not open: connect it again")
        return self._shared.read(self, self._waiting)

    def close(self) -> None:
        """Let the board go, whose stream ends with its last reader; twice is harmless."""
        self._leave()

    def _leave(self) -> None:
        shared, self._shared = self._shared, None
        if shared is not None:
            with _CONNECTING:
                shared.dismiss(self)
                if not shared.readers and shared in OPEN_BOARDS:
                    OPEN_BOARDS.remove(shared)

    def give(self, arrived: Arrived, scans: Sequence[VoltageReading]) -> None:
        """Keep its own part of the scans that have arrived until they are read."""
        self._faults.update(arrived.faults)
        if scans:
            self.arrival_ns = arrived.arrival_ns
            dropped = len(self._waiting) + len(scans) - _MOST_WAITING
            if dropped > 0:
                self._faults["lost scans"] += dropped
            self._waiting.extend(scans)

    def conflict(self, others: "Sequence[SharedInputs[Channel]]") -> str:
        """Return why one stream cannot serve it beside others, empty where it can."""
        for other in others:
            if other.rate_hz != self.rate_hz:
                return (
                    f"one asks for {self.rate_hz:g} scans a second, another for "
                    f"{other.rate_hz:g}, and it has one clock: give them the same rate_hz"
                )
        return self.misfit(others)

    def same_kind(self, other: "SharedInputs[Any]") -> bool:
        """Return whether another is of the same kind of board, reached in the same way."""
        return type(other) is type(self) and other.backend is self.backend


_MADE: "Final[weakref.WeakSet[SharedInputs[Any]]]" = weakref.WeakSet()
"""Those of all drivers that were made, also of those that are not connected yet."""
OPEN_BOARDS: "Final[list[SharedBoard[Any]]]" = []
_CONNECTING: Final = threading.Lock()
"""Held while a board is opened or closed, which takes long; reading does not wait for it."""


class SharedBoard(Generic[Channel]):
    """A board that is open, and those who read it."""

    def __init__(self) -> None:
        self.readers: tuple[SharedInputs[Channel], ...] = ()
        self.stream: BoardStream | None = None
        self._board: int | str | None = None
        self._channels: tuple[Channel, ...] = ()
        self._picks: list[tuple[SharedInputs[Channel], tuple[int, ...] | None]] = []
        self._feeding = threading.Lock()
        self._gone = False

    def serves(self, reader: SharedInputs[Channel]) -> bool:
        """Return whether it is the board that the reader wants."""
        return self.readers[0].same_kind(reader) and reader.board in {None, self._board}

    def admit(self, reader: SharedInputs[Channel]) -> None:
        """Add a reader, and begin the stream where none runs that has its channels."""
        others = [other for other in self.readers if other is not reader]
        if problem := reader.conflict(others):
            shared = f" is shared by {len(others) + 1} drivers" if others else ""
            raise InputError(f"a {reader.what}{shared}: {problem}")
        stream = self.stream
        if stream is None or not stream.flows or not set(reader.channels) <= set(self._channels):
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
        """Return what has come for a reader, oldest first; never blocks.

        Raises
        ------
        DeviceLost
            The board was unplugged, which every reader is told.
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
        """Give each reader its columns of what has come."""
        if self._gone:
            raise DeviceLost(f"the {what} is gone: plug it in again")
        if self.stream is None:
            return
        arrived = self.stream.take()
        for reader, columns in self._picks:
            scans = arrived.scans
            if columns is not None:
                scans = [
                    VoltageReading(t, tuple([volts[at] for at in columns])) for t, volts in scans
                ]
            reader.give(arrived, scans)

    def _begin(self, readers: Sequence[SharedInputs[Channel]]) -> None:
        """Open the board again and start a stream for these readers.

        Drivers that were made for it and are not connected yet have their channels in it as
        well, where they fit: when they connect, no stream is interrupted.
        """
        with self._feeding:
            old, self.stream = self.stream, None  # until then nothing comes, which is no loss
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
        """Return where a reader's channels are in a scan, None where they are the scan."""
        if reader.channels == self._channels:
            return None
        return tuple(self._channels.index(channel) for channel in reader.channels)


def _with_those_to_come(
    readers: Sequence[SharedInputs[Channel]], board: int | str
) -> list[SharedInputs[Channel]]:
    chosen = sorted(readers, key=lambda reader: reader.number)
    for other in sorted(_MADE, key=lambda reader: reader.number):
        same = other.same_kind(readers[0]) and other.board in {None, board}
        if same and other not in chosen and not other.conflict(chosen):
            chosen.append(other)
    return chosen
