"""Offset and drift between two machines' clocks, from exchanged time stamps.

The offset is the other clock minus this one. Each exchange bounds the offset from both sides,
because no message arrives before it is sent: a message that left here at t1 and arrived there at
t2 shows that the offset is at most t2 - t1; one that left there at t3 and arrived here at t4 shows
that it is at least t3 - t4. The quickest messages of each direction give the closest bounds, and
their midpoint is the estimate: exact if the quickest messages of both directions take equally
long, and never wrong by more than half of their total time. Each direction has its bound by
itself, because with jitter the quickest messages of both seldom meet in one exchange. As in S. B.
Moon, P. Skelly, D. Towsley: *Estimation and Removal of Clock Skew from Network Delay
Measurements*, INFOCOM 1999, the drift is the slope of these bounds; here it is the median slope
between blocks half of the history apart (Theil's incomplete method), shrunk the more such slopes
disagree.

Nothing here reads a clock: the caller passes the time stamps that were exchanged.
"""

import math
import statistics
from collections import deque
from dataclasses import dataclass
from typing import Final

BLOCK_NS: Final = 500_000_000
"""Length of a block; for each block the closest bound of each direction is kept."""

_DRIFT_BLOCKS: Final = 128
_OFFSET_BLOCKS: Final = (8, 32, 64)
"""Numbers of newest blocks from which the offset may be bounded."""
_LEAST_BLOCKS: Final = 6
"""Blocks before a drift is estimated."""
_LEAST_EXCHANGES: Final = 8
_USUAL_DRIFT: Final = 50e-6
"""Usual drift of two quartz clocks; an estimate with a much larger error counts little."""
_LARGEST_DRIFT: Final = 500e-6
_MARGIN_NS: Final = 500_000
_MARGIN_DRIFT: Final = 300e-6
_WITNESSES: Final = 3
"""Exchanges in a row that contradict the estimate before it is given up."""
_STEP_BLOCKS: Final = 4
_BLOCKS_BEFORE_STEP: Final = 8
_STEP_HISTORY: Final = 32


Bounds = tuple[int, int, int]
"""Time, lower bound and upper bound of the offset (ns)."""


@dataclass(frozen=True)
class ClockEstimate:
    """The other clock as seen from this one.

    Parameters
    ----------
    time_ns
        Time of the estimate, by this clock.
    offset_ns
        The other clock minus this one, at that time.
    drift
        Seconds that the other clock gains in a second of this one.
    uncertainty_ns
        Half of the distance between the bounds.
    """

    time_ns: int
    offset_ns: int
    drift: float
    uncertainty_ns: int

    def at(self, time_ns: int) -> int:
        """Return the offset (ns) at a time of this clock."""
        return self.offset_ns + round(self.drift * (time_ns - self.time_ns))


@dataclass(frozen=True)
class ClockJump:
    """A jump of the other clock by `step_ns` against this one, or of this one by the opposite."""

    time_ns: int
    step_ns: int

    def describe(self) -> str:
        """Return what happened, as the end of a sentence about the other clock."""
        return f"jumped by {self.step_ns / 1e9:+.3f} s against the one here"


@dataclass
class _Block:
    """The closest bounds within a block, as (time, bound), relative to the origins."""

    number: int
    least: tuple[int, int]
    most: tuple[int, int]

    def add(self, time_ns: int, least_ns: int, most_ns: int) -> None:
        if least_ns > self.least[1]:
            self.least = (time_ns, least_ns)
        if most_ns < self.most[1]:
            self.most = (time_ns, most_ns)


class ClockOffset:
    """Track another clock's offset from this one.

    The memory is bounded, and so is the time that `add` takes, about 0.1 ms.
    """

    def __init__(self) -> None:
        self.jumps = 0
        """Jumps detected since the start."""
        self.exchanges = 0
        """Exchanges used since the start."""
        self.reset()

    def reset(self) -> None:
        """Forget the history, for another clock; the counts go on."""
        self._origin: tuple[int, int] | None = None
        self._blocks: deque[_Block] = deque(maxlen=_DRIFT_BLOCKS)
        self._drift, self._drift_error = 0.0, _USUAL_DRIFT
        self._used = 0
        self._estimate: ClockEstimate | None = None
        self._doubted: list[Bounds] = []

    @property
    def estimate(self) -> ClockEstimate | None:
        """The current estimate, or None before the first eight exchanges."""
        return self._estimate if self._used >= _LEAST_EXCHANGES else None

    def add(self, time_ns: int, least_ns: int, most_ns: int) -> ClockJump | None:
        """Take the bounds of one exchange; return a jump if they reveal one, else None.

        Parameters
        ----------
        time_ns
            When the exchange ended, by this clock.
        least_ns, most_ns
            Bounds of the offset; ignored if `least_ns` is above `most_ns`.
        """
        if least_ns > most_ns:
            return None
        self.exchanges += 1
        if self._estimate is not None and self._contradicts(time_ns, least_ns, most_ns):
            self._doubted.append((time_ns, least_ns, most_ns))
            if len(self._doubted) < _WITNESSES:
                return None
            return self._begin_behind(self._doubted, self._estimate.at(time_ns))
        self._doubted.clear()
        return self._take((time_ns, least_ns, most_ns))

    def _contradicts(self, time_ns: int, least_ns: int, most_ns: int) -> bool:
        estimate = self._estimate
        if estimate is None:
            return False
        slack_ns = estimate.uncertainty_ns + _MARGIN_NS
        slack_ns += round(_MARGIN_DRIFT * abs(time_ns - estimate.time_ns))
        expected_ns = estimate.at(time_ns)
        return least_ns > expected_ns + slack_ns or most_ns < expected_ns - slack_ns

    def _begin_behind(self, bounds: list[Bounds], expected_ns: int) -> ClockJump:
        """Begin anew from the bounds after a jump; return the jump from the expected offset."""
        self.reset()
        for bound in bounds:
            self._take(bound)
        time_ns = bounds[-1][0]
        assert self._estimate is not None  # noqa: S101 - there is one from the first on
        self.jumps += 1
        return ClockJump(time_ns, self._estimate.at(time_ns) - expected_ns)

    def _take(self, bounds: Bounds) -> ClockJump | None:
        """Use one exchange; return a jump if the blocks before it show one."""
        if self._origin is None:
            self._origin = bounds[:2]
        start_ns, zero_ns = self._origin
        time, least, most = bounds[0] - start_ns, bounds[1] - zero_ns, bounds[2] - zero_ns
        number = time // BLOCK_NS
        if self._blocks and number <= self._blocks[-1].number:
            self._blocks[-1].add(time, least, most)
        else:
            jump = self._step_of_blocks()
            if jump is not None:
                self._take(bounds)
                return jump
            if self._blocks:
                self._drift, self._drift_error = _drift(self._blocks)
            self._blocks.append(_Block(number, (time, least), (time, most)))
        self._used += 1
        self._estimate = self._fit(time)
        return None

    def _fit(self, time: int) -> ClockEstimate:
        assert self._origin is not None  # noqa: S101 - something was taken
        start_ns, zero_ns = self._origin
        least, most = self._closest(time)
        return ClockEstimate(
            time_ns=time + start_ns,
            offset_ns=zero_ns + round((least + most) / 2),
            drift=self._drift,
            uncertainty_ns=max(0, round((most - least) / 2)),
        )

    def _closest(self, time: int) -> tuple[float, float]:
        """Return the bounds at a time, from the length of history with the least uncertainty."""
        blocks = list(self._blocks)
        best, chosen = math.inf, (0.0, 0.0)
        for count in _OFFSET_BLOCKS:
            recent = blocks[-count:]
            least, most = _bounds(recent, time, self._drift)
            span = time - min(recent[0].least[0], recent[0].most[0])
            doubt = (most - least) / 2 + 2 * self._drift_error * span
            crossed = most < least  # after a jump too small to tell from jitter
            if best == math.inf or (doubt < best and not crossed):
                best, chosen = doubt, (least, most)
            if count >= len(blocks):
                break
        return chosen

    def _step_of_blocks(self) -> ClockJump | None:
        """Begin anew if both bounds of the newest blocks are off in the same direction.

        A change of a delay moves the bounds apart or together, a clock's step moves both alike. A
        step is found if it exceeds the effect of jitter on the bounds of a block.
        """
        blocks = list(self._blocks)[-_STEP_HISTORY:]
        if self._origin is None or len(blocks) <= _STEP_BLOCKS + _BLOCKS_BEFORE_STEP:
            return None
        new = blocks[-_STEP_BLOCKS:]
        old = blocks[: -_STEP_BLOCKS - 1]  # the step fell into the block between
        time = max(new[-1].least[0], new[-1].most[0])
        least, most = _bounds(old, time, self._drift)
        of_old, of_new = (
            [
                (
                    _extrapolate(block.least, time, self._drift) - least,
                    _extrapolate(block.most, time, self._drift) - most,
                )
                for block in some
            ]
            for some in (old, new)
        )
        threshold = _MARGIN_NS + max(max(-low, high) for low, high in of_old)
        up = all(min(pair) > threshold for pair in of_new)
        down = all(max(pair) < -threshold for pair in of_new)
        if not (up or down):
            return None
        start_ns, zero_ns = self._origin
        behind = [
            (
                max(block.least[0], block.most[0]) + start_ns,
                block.least[1] + zero_ns,
                block.most[1] + zero_ns,
            )
            for block in new
        ]
        return self._begin_behind(behind, zero_ns + round((least + most) / 2))


def _extrapolate(bound: tuple[int, int], time: int, drift: float) -> float:
    """Return a bound, extrapolated to another time."""
    return bound[1] + drift * (time - bound[0])


def _bounds(blocks: list[_Block], time: int, drift: float) -> tuple[float, float]:
    """Return the closest bounds of the offset at a time."""
    return (
        max(_extrapolate(block.least, time, drift) for block in blocks),
        min(_extrapolate(block.most, time, drift) for block in blocks),
    )


def _drift(blocks: deque[_Block]) -> tuple[float, float]:
    """Return the slope of both bounds, shrunk towards zero if uncertain, and its error."""
    count = len(blocks)
    if count < _LEAST_BLOCKS:
        return 0.0, _USUAL_DRIFT
    half = count // 2
    slopes = []
    for index in range(count - half):
        early, late = blocks[index], blocks[index + half]
        for first, second in ((early.least, late.least), (early.most, late.most)):
            if second[0] - first[0] >= BLOCK_NS:  # this clock may have jumped back
                slopes.append((second[1] - first[1]) / (second[0] - first[0]))
    if not slopes:
        return 0.0, _USUAL_DRIFT
    middle = statistics.median(slopes)
    deviation = statistics.median(abs(slope - middle) for slope in slopes)
    # standard error of the median of so many normal values, enlarged if they are few
    error = 1.86 * deviation / len(slopes) ** 0.5 * (1.0 + 8.0 / len(slopes))
    trust = _USUAL_DRIFT**2 / (_USUAL_DRIFT**2 + error**2)
    drift = max(-_LARGEST_DRIFT, min(_LARGEST_DRIFT, middle * trust))
    return drift, error * trust**0.5
