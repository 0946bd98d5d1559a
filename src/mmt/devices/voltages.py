"""What an acquisition board offers to a sensor that gives bare voltages."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol


class VoltageReading(NamedTuple):
    """The voltages of several inputs at one instant."""

    time_ns: int
    """By the board's own clock, unwrapped."""
    volts: tuple[float, ...]
    """In the order of the inputs that the board was asked for."""


class VoltageBoard(Protocol):
    """A board that samples inputs at a rate of its own.

    Which inputs, how fast and how amplified are options of the board's driver.
    """

    latency_ns: int
    """From the physical instant to the stamp, as far as it is known."""
    inputs: int
    """How many voltages a reading has."""
    limit_v: float
    """Largest magnitude that it measures."""

    def connect(self) -> None:
        """Open the board and begin to sample.

        Raises
        ------
        MmtError
            It does not answer; the message says what to check.
        """

    def read(self) -> Sequence[VoltageReading]:
        """Return what has come since the last call, oldest first; never blocks.

        Raises
        ------
        DeviceLost
            The board does not answer any more; `connect` may be called again later.
        """

    def close(self) -> None:
        """Release the board; calling it twice is harmless."""

    @property
    def faults(self) -> Mapping[str, int]:
        """Counts by what went wrong and was survived."""
