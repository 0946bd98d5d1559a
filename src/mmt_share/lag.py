"""Lag of a listener, measured by its answers to states of the hand."""

import struct
from typing import Any, Final, NamedTuple

from mmt.core.errors import InputError
from mmt.core.running.ticking import TimeHistogram
from mmt.link.clock_offset import ClockOffset

FIRST_ANSWERS: Final = 8
"""Answers that are needed to know the offset of the clocks."""

_HAVE: Final = struct.Struct("<Iqd")
_LATEST_NS: Final = 2**61


class ListenerState(NamedTuple):
    """What a listener has: the argument of `HAVE`, 20 bytes.

    Attributes
    ----------
    number
        Number of its model, 0 before the first.
    arrived_ns
        When the state arrived, by the listener's monotonic clock.
    time_s
        Session time of that state.
    """

    number: int
    arrived_ns: int
    time_s: float

    def pack(self) -> bytes:
        """Return the bytes for the wire."""
        return _HAVE.pack(*self)

    @classmethod
    def unpack(cls, data: object) -> "ListenerState":
        """Parse an answer, which is not trusted.

        Raises
        ------
        InputError
            It is malformed.
        """
        if not isinstance(data, bytes) or len(data) != _HAVE.size:
            raise InputError("what a listener says that it has is malformed")
        have = cls(*_HAVE.unpack(data))
        if not 0 <= have.arrived_ns < _LATEST_NS:
            raise InputError(f"a listener's clock says {have.arrived_ns} ns")
        return have


class Lag:
    """Time from the making of a state at the leader to its arrival at a listener.

    Each answer bounds the offset of the listener's clock from both sides. So the lag is right to
    half of the shortest round-trip time (`mmt.link.clock_offset`), from the eighth answer on.
    """

    def __init__(self) -> None:
        self.number: int | None = None
        """Number of the listener's newest model, or None before its first answer."""
        self.answered_ns: int | None = None
        self.last_ms: float | None = None
        self._offset = ClockOffset()
        self._lags: TimeHistogram | None = None  # some listeners never answer

    def record_answer(self, state: ListenerState, made_ns: int | None, now_ns: int) -> None:
        """Take an answer.

        Parameters
        ----------
        state
            What the listener has.
        made_ns
            When the state was made, by the clock of this machine; None if that is not known.
        now_ns
            When the answer came, by the same clock.
        """
        self.number, self.answered_ns = state.number, now_ns
        if made_ns is None:
            return
        self._offset.add(now_ns, state.arrived_ns - now_ns, state.arrived_ns - made_ns)
        estimate = self._offset.estimate
        if estimate is None:
            return
        lag_ns = max(0, state.arrived_ns - estimate.at(now_ns) - made_ns)
        if self._lags is None:
            self._lags = TimeHistogram()
        self._lags.add(lag_ns)
        self.last_ms = lag_ns / 1e6

    def figures(self, now_ns: int) -> dict[str, Any]:
        """Return the lag for a table, times in ms and s; a figure is None if it is not known."""
        lags, answered_ns = self._lags, self.answered_ns
        return {
            "number": self.number,
            "answered_s": None if answered_ns is None else round((now_ns - answered_ns) / 1e9, 3),
            "lag_ms": _rounded(self.last_ms),
            "lag_p50_ms": _rounded(None if lags is None else lags.quantile_ms(0.5)),
            "lag_p99_ms": _rounded(None if lags is None else lags.quantile_ms(0.99)),
        }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
