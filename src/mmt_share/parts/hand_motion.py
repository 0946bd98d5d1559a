"""Motion of a hand that moves a robot at another machine: its jitter buffer, and the clutch."""

from collections import deque
from typing import Final

from mmt.core.arrays import RecordArray, Vector, difference
from mmt.devices.leader_reports import InterfaceState

_WINDOW: Final = 200
"""Messages whose delay is remembered: two seconds at a hundred messages a second."""
_MOST_RECORDS: Final = 4000
_STRETCH: Final = 0.1
"""Largest relative change of the playback speed, by which it follows the network's delay."""


class OperatorMotion:
    """Buffer the records of a hand, and play them at the leader's times.

    The delay is chosen so that even the latest message of the last two seconds would have come in
    time for its first record. Between records the position is interpolated; after the newest
    record the hand stands still.

    Parameters
    ----------
    longest_ns
        Messages that are later than the quickest by more than this do not count for the delay.
    """

    def __init__(self, longest_ns: int) -> None:
        self._longest_ns = longest_ns
        self._records: deque[tuple[int, Vector, Vector, float, bool]] = deque(maxlen=_MOST_RECORDS)
        self._lags_ns: deque[int] = deque(maxlen=_WINDOW)
        self._newest_ns = -1
        self._due_ns: float | None = None
        self._now_ns = 0

    @property
    def delay_ms(self) -> float:
        """Delay that the buffer adds to the quickest message, in ms."""
        lags = self._lags_ns
        return (self._lag_ns() - min(lags)) / 1e6 if lags else 0.0

    def add(self, records: RecordArray, arrival_ns: int) -> None:
        """Add records (n,), n >= 1; those that are not newer than the newest are left out."""
        added = False
        columns = [records[name].tolist() for name in records.dtype.names or ()]
        for time_ns, (x, y, z), (u, v, w), force_n, contact in zip(*columns, strict=True):
            if time_ns > self._newest_ns:
                if not added:
                    self._lags_ns.append(arrival_ns - time_ns)
                    added = True
                self._newest_ns = time_ns
                pressed_n = max(force_n, 0.0)
                self._records.append((time_ns, (x, y, z), (u, v, w), pressed_n, contact != 0))

    def at(self, now_ns: int) -> InterfaceState | None:
        """Return the state of the hand to use now, or None before the first record."""
        if not self._records:
            return None
        self._advance(now_ns)
        records, due_ns = self._records, self._due_ns or 0.0
        while len(records) > 1 and records[1][0] <= due_ns:
            records.popleft()
        time_ns, position, velocity, force_n, contact = records[0]
        if len(records) == 1:
            still = velocity if due_ns <= time_ns else (0.0, 0.0, 0.0)
            return InterfaceState(position, still, force_n, contact)
        share = max(0.0, (due_ns - time_ns) / (records[1][0] - time_ns))
        a, b, c = position
        x, y, z = records[1][1]
        between = (a + share * (x - a), b + share * (y - b), c + share * (z - c))
        return InterfaceState(between, velocity, force_n, contact)

    def _lag_ns(self) -> int:
        quickest_ns = min(self._lags_ns)
        return max(lag for lag in self._lags_ns if lag - quickest_ns <= self._longest_ns)

    def _advance(self, now_ns: int) -> None:
        """Advance the playback time towards the time that is due now, at a bounded speed."""
        wanted_ns = float(now_ns - self._lag_ns())
        step_ns = now_ns - self._now_ns
        self._now_ns = now_ns
        if self._due_ns is None or abs(wanted_ns - self._due_ns) > 2 * self._longest_ns:
            self._due_ns = wanted_ns
            return
        low, high = (1.0 - _STRETCH) * step_ns, (1.0 + _STRETCH) * step_ns
        self._due_ns += min(max(wanted_ns - self._due_ns, low), high)


class Clutch:
    """Offset between a robot and the hand that moves it, which shrinks while the hand moves.

    The robot makes the hand's own motion from the first moment. The offset shrinks along each axis
    on its own, so that a small offset along the surface's normal does not wait for a large one
    across the surface. It shrinks no faster than the hand moves, so that a hand at rest leaves the
    robot at rest, and no faster than a bound. People hardly notice such a shrinking offset (Conti,
    Khatib, "Spanning large workspaces using small haptic devices", World Haptics 2005).

    Parameters
    ----------
    robot_mm
        Position of the robot.
    hand_mm
        Position of the hand.
    recovery_mm_s
        Largest speed at which the offset shrinks along each axis.
    """

    def __init__(self, robot_mm: Vector, hand_mm: Vector, recovery_mm_s: float) -> None:
        self.offset_mm: Vector = difference(robot_mm, hand_mm)
        """Position of the robot minus position of the hand."""
        self._recovery_mm_s = recovery_mm_s

    def step(self, hand: InterfaceState, elapsed_s: float) -> Vector:
        """Return the wanted position of the robot (mm), `elapsed_s` after the last call."""
        u, v, w = hand.velocity_mm_s
        speed_mm_s = min((u * u + v * v + w * w) ** 0.5, self._recovery_mm_s)
        most_mm = speed_mm_s * elapsed_s
        dx, dy, dz = (offset - min(max(offset, -most_mm), most_mm) for offset in self.offset_mm)
        self.offset_mm = (dx, dy, dz)
        x, y, z = hand.position_mm
        return (x + dx, y + dy, z + dz)
