"""Strokes of a person who was asked to explore at all speeds and forces.

The hand strokes back and forth. Each stroke has one to three stretches of steady speed and
force, with smooth changes between them. The heading turns from stroke to stroke, the centre
wanders, and now and then the hand rests or lifts off. Speeds and forces come from a
low-discrepancy sequence over the range (Roberts' R2, shifted by the seed), since a person who
tries everything does not try the same twice in a row. If all headings are asked for, they come
from another such sequence, in the order in which the workspace has room for them.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from mmt.scene import Hand

REACH_MM: Final = 85.0
"""Strokes are aimed to end within this distance of the centre of the workspace."""

_GOLDEN: Final = 0.6180339887498949
_TRIES: Final = 16
_R2: Final = (0.7548776662466927, 0.5698402909980532)
_ACCELERATION_MM_S2: Final = 3000.0
_FORCE_RATE_N_S: Final = 20.0
_SHORTEST_RAMP_S: Final = 0.06
_LONGEST_STROKE_MM: Final = 120.0
_LIFT_MM: Final = (4.0, 12.0)
_STROKES_BETWEEN_LIFTS: Final = (7, 14)


class Intent(NamedTuple):
    """Intended motion for the next tick; `heading_rad` None keeps the heading."""

    speed_mm_s: float
    force_n: float
    clearance_mm: float = 0.0
    heading_rad: float | None = None
    turn_rad_mm: float = 0.0


Place = Callable[[], tuple[float, float]]
"""Returns the hand's position, x and y (mm)."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A smooth change to new values, then a stretch that holds them.

    The change is a half-cosine of `ramp_ticks`; the stretch lasts `hold_ticks`.
    """

    ramp_ticks: int
    hold_ticks: int
    speed_mm_s: float
    force_n: float
    clearance_mm: float = 0.0
    heading_rad: float | None = None
    """New heading; given only if the hand stands still."""
    turn_rad_mm: float = 0.0
    """Curvature of the path in this phase."""


@dataclass(frozen=True, slots=True)
class _Steady:
    speed: float
    force: float
    hold_s: float


class HeadingPlanner:
    """Chooses the heading of each stroke, so that it ends within reach.

    Parameters
    ----------
    settings
        How headings are chosen.
    generator
        Source of every random number.
    """

    def __init__(self, settings: Hand, generator: np.random.Generator) -> None:
        self._opposite = settings.headings == "opposite"
        self._random = generator
        self._heading = float(generator.uniform(0.0, 2.0 * math.pi))
        self._waiting: deque[float] = deque(maxlen=_TRIES)

    def __call__(self, x_mm: float, y_mm: float, length_mm: float) -> float:
        """Return the heading (rad) of a stroke of this length from here."""
        return (self._turned if self._opposite else self._free_heading)(x_mm, y_mm, length_mm)

    def _between(self, low: float, high: float) -> float:
        return low + (high - low) * float(self._random.random())

    def _turned(self, x_mm: float, y_mm: float, length_mm: float) -> float:
        """Turn round, more or less; if that leaves the workspace, turn to its centre."""
        wish = self._heading + math.pi + self._between(-0.35, 0.35)
        if self._random.random() < 0.15:
            wish = self._between(0.0, 2.0 * math.pi)
        if not _within_reach(x_mm, y_mm, length_mm, wish):
            wish = math.atan2(-y_mm, -x_mm) + self._between(-0.2, 0.2)
        self._heading = wish
        return wish

    def _free_heading(self, x_mm: float, y_mm: float, length_mm: float) -> float:
        """Take the next heading of an even sequence for which the workspace has room.

        Headings without room now wait for a stroke that starts elsewhere.
        """
        for _ in range(_TRIES - len(self._waiting)):
            self._heading = (self._heading + 2.0 * math.pi * _GOLDEN) % (2.0 * math.pi)
            self._waiting.append(self._heading)
        for heading in self._waiting:
            if _within_reach(x_mm, y_mm, length_mm, heading):
                self._waiting.remove(heading)
                return heading
        return math.atan2(-y_mm, -x_mm) + self._between(-0.2, 0.2)


class StrokePlanner:
    """An endless, seeded supply of phases.

    Parameters
    ----------
    settings
        Range of speeds and forces, how headings are chosen, and the share of time at rest.
    generator
        Source of every random number.
    """

    def __init__(self, settings: Hand, generator: np.random.Generator) -> None:
        self._settings = settings
        self._random = generator
        self._drawn = 0
        self._shift = (generator.random(), generator.random())
        self._aim = HeadingPlanner(settings, generator)
        self._rest_due_s = 0.0
        self._until_lift = self._next_lift()

    def stroke(self, x_mm: float, y_mm: float) -> Iterator[Phase]:
        """Yield the phases of the next stroke, which starts here and at rest.

        A rest or a lift-off that is due comes first.
        """
        steady = self._stretches(REACH_MM + math.hypot(x_mm, y_mm))
        yield from self._rest(steady[0].force)
        if self._until_lift == 0:
            self._until_lift = self._next_lift()
            yield from self._lift()
        self._until_lift -= 1
        yield from self._moves(steady, x_mm, y_mm)

    def _between(self, low: float, high: float) -> float:
        return low + (high - low) * float(self._random.random())

    def _next_lift(self) -> int:
        return int(self._random.integers(*_STROKES_BETWEEN_LIFTS))

    def _draw(self) -> _Steady:
        self._drawn += 1
        along, across = (
            (shift + self._drawn * step) % 1.0 for shift, step in zip(self._shift, _R2, strict=True)
        )
        hand = self._settings
        speed = hand.slowest_mm_s + along * (hand.fastest_mm_s - hand.slowest_mm_s)
        force = hand.lightest_n + across * (hand.strongest_n - hand.lightest_n)
        return _Steady(speed, force, self._between(0.18, 0.28))

    def _stretches(self, room_mm: float) -> list[_Steady]:
        """Draw stretches until the stroke is long enough for a person to turn round."""
        longest_mm = min(_LONGEST_STROKE_MM, room_mm)
        first = self._draw()
        over_s = max(0.0, (_length_mm([first]) - longest_mm) / first.speed)
        stretches = [_Steady(first.speed, first.force, max(first.hold_s - over_s, 0.0))]
        enough_mm = self._between(30.0, 90.0)
        while len(stretches) < 3 and _length_mm(stretches) < enough_mm:
            following = self._draw()
            if _length_mm([*stretches, following]) > longest_mm:
                self._drawn -= 1
                break
            stretches.append(following)
        return stretches

    def _rest(self, force_n: float) -> Iterator[Phase]:
        rest_s = self._between(0.2, 0.5)
        if self._rest_due_s >= rest_s:
            self._rest_due_s -= rest_s
            yield Phase(_ticks(0.15), _ticks(rest_s), 0.0, min(force_n, 0.5))

    def _lift(self) -> Iterator[Phase]:
        clearance = self._between(*_LIFT_MM)
        yield Phase(_ticks(0.15), 1, 0.0, 0.0)
        yield Phase(_ticks(0.20), _ticks(self._between(0.05, 0.2)), 0.0, 0.0, clearance)
        yield Phase(_ticks(0.25), 1, 0.0, 0.0)

    def _moves(self, stretches: list[_Steady], x_mm: float, y_mm: float) -> Iterator[Phase]:
        length_mm = _length_mm(stretches)
        heading: float | None = self._aim(x_mm, y_mm, length_mm)
        # A wrist's stroke bows by a fraction of a millimetre.
        turn = self._between(-0.04, 0.04) / length_mm
        before = _Steady(0.0, 0.0, 0.0)
        moving_s = 0.0
        for stretch in stretches:
            ramp_s = _ramp_s(before, stretch) * self._between(0.9, 1.2)
            yield Phase(
                _ticks(ramp_s),
                _ticks(stretch.hold_s),
                stretch.speed,
                stretch.force,
                heading_rad=heading,
                turn_rad_mm=turn,
            )
            heading, before = None, stretch
            moving_s += ramp_s + stretch.hold_s
        stop_s = _ramp_s(before, _Steady(0.0, before.force, 0.0))
        yield Phase(_ticks(stop_s), 1, 0.0, before.force, turn_rad_mm=turn)
        share = self._settings.rest_share
        self._rest_due_s += (moving_s + stop_s) * share / (1.0 - share)


def _within_reach(x_mm: float, y_mm: float, length_mm: float, heading_rad: float) -> bool:
    end_x_mm = x_mm + length_mm * math.cos(heading_rad)
    return math.hypot(end_x_mm, y_mm + length_mm * math.sin(heading_rad)) <= REACH_MM


def _ramp_s(before: _Steady, after: _Steady) -> float:
    return max(
        _SHORTEST_RAMP_S,
        abs(after.speed - before.speed) / _ACCELERATION_MM_S2,
        abs(after.force - before.force) / _FORCE_RATE_N_S,
    )


def _length_mm(stretches: list[_Steady]) -> float:
    length, before = 0.0, _Steady(0.0, 0.0, 0.0)
    for stretch in [*stretches, _Steady(0.0, stretches[-1].force, 0.0)]:
        length += _ramp_s(before, stretch) * 0.5 * (before.speed + stretch.speed)
        length += stretch.hold_s * stretch.speed
        before = stretch
    return length


def _ticks(duration_s: float) -> int:
    return max(1, round(duration_s * 1000.0))


def in_phases(phases: Iterable[Phase], clearance_mm: float = 0.0) -> Iterator[Intent]:
    """Yield the intents of phases, the first of which begins at rest at a clearance."""
    before = (0.0, 0.0, clearance_mm)
    for phase in phases:
        after = (phase.speed_mm_s, phase.force_n, phase.clearance_mm)
        for tick in range(1, phase.ramp_ticks + phase.hold_ticks + 1):
            values = after
            if tick < phase.ramp_ticks:
                share = 0.5 - 0.5 * math.cos(math.pi * tick / phase.ramp_ticks)
                speed, force, clearance = before
                values = (
                    speed + share * (after[0] - speed),
                    force + share * (after[1] - force),
                    clearance + share * (after[2] - clearance),
                )
            yield Intent(*values, phase.heading_rad if tick == 1 else None, phase.turn_rad_mm)
        before = after


def strokes(hand: Hand, random: np.random.Generator, place: Place) -> Iterator[Intent]:
    """Stroke to and fro in stretches of steady speed and force, see `StrokePlanner`."""
    planner = StrokePlanner(hand, random)

    def phases() -> Iterator[Phase]:
        while True:
            yield from planner.stroke(*place())

    return in_phases(phases())
