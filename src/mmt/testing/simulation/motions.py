"""The intended motion of a simulated hand, tick by tick: a function for each kind but `strokes`.

This project's methods were tried with `mmt.testing.simulation.strokes`. These kinds judge them on
different motion: no stretches of steady speed, short contacts, reversals, rests. They low-pass
their force, since a hand's force does not jump.
"""

from collections.abc import Callable, Iterator, Mapping
from math import atan2, exp, hypot, pi, sin
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from mmt.scene import Hand
from mmt.testing.simulation import PERIOD_S, RATE_HZ
from mmt.testing.simulation.strokes import (
    REACH_MM,
    HeadingPlanner,
    Intent,
    Phase,
    Place,
    in_phases,
)

if TYPE_CHECKING:
    from mmt.testing.simulation.recorded_path import RecordedPath

FORCE_BAND_HZ: Final = 8.0

_RAMP_SHARE: Final = 0.15
_LIFTED: Final = 0.12  # share of strokes and of parts of circles before which the hand lifts off
_LIFTED_SCRATCHING: Final = 0.4  # the same for bouts of scratching


Motion = Callable[[Hand, np.random.Generator, Place], Iterator[Intent]]
"""Yields intents without end, from a hand at rest on the surface without force."""


def motion(settings: Hand, generator: np.random.Generator, place: Place) -> Iterator[Intent]:
    """Return the intents of the kind that the settings name, other than `strokes`.

    Raises
    ------
    InputError
        The file of a recorded stroke is not usable.
    """
    if settings.kind in KINDS:
        return _low_passed(KINDS[settings.kind](settings, generator, place))
    from mmt.testing.simulation.recorded_path import load_path

    return followed(load_path(Path(settings.kind)), place)


def quick(hand: Hand, random: np.random.Generator, place: Place) -> Iterator[Intent]:
    """Make strokes of 250 to 700 ms, from rest to rest, each with its own speed and force."""
    aim = HeadingPlanner(hand, random)
    while True:
        if random.random() < _LIFTED:
            yield from _lift(random)
        yield from _stroke(hand, random, aim, place)


def circles(hand: Hand, random: np.random.Generator, place: Place) -> Iterator[Intent]:
    """Circle with drifting speed and force; now and then another radius, 8 to 30 mm."""

    def phases() -> Iterator[Phase]:
        radius, heading = 8.0, float(random.uniform(0.0, 2.0 * pi))
        sense = 1.0 if random.random() < 0.5 else -1.0
        towards: float | None = heading
        while True:
            if random.random() < _LIFTED:
                yield Phase(150, 100, 0.0, 0.0, 5.0, turn_rad_mm=sense / radius)
                yield Phase(150, 1, 0.0, 0.0)
            ticks = int(random.integers(600, 1800))
            speed, force = _speed(hand, random), _force(hand, random)
            yield Phase(ticks, 1, speed, force, 0.0, towards, sense / radius)
            towards = None
            # a smaller circle that touches from inside has room wherever the larger one had
            wish = float(random.uniform(8.0, 30.0))
            radius = wish if hypot(*place()) + 2.0 * wish <= REACH_MM else min(wish, radius)

    return in_phases(phases())


def taps(hand: Hand, random: np.random.Generator, place: Place) -> Iterator[Intent]:
    """Touch for 50 to 400 ms and leave for 100 to 350 ms; half of the touches slide."""
    aim = HeadingPlanner(hand, random)
    while True:
        ticks = int(random.integers(50, 400))
        force = _force(hand, random)
        speed = _speed(hand, random) if random.random() < 0.5 else 0.0
        heading: float | None = aim(*place(), speed * ticks * PERIOD_S)
        for tick in range(ticks):
            push = sin(pi * (tick + 0.5) / ticks)
            yield Intent(speed * push, force * push, 0.0, heading)
            heading = None
        yield from _lift(random, (100, 350))


def scratching(hand: Hand, random: np.random.Generator, place: Place) -> Iterator[Intent]:
    """Move fast back and forth over 6 to 25 mm, 6 to 20 times, then elsewhere."""
    aim = HeadingPlanner(hand, random)
    while True:
        if random.random() < _LIFTED_SCRATCHING:
            yield from _lift(random)
        yield from _stroke(hand, random, aim, place)
        length = float(random.uniform(6.0, 25.0))
        heading = aim(*place(), length)
        for _ in range(int(random.integers(6, 20))):
            # the peak of a half sine, from the upper half of the range of speeds
            peak = 0.5 * (hand.fastest_mm_s + _speed(hand, random))
            force, ticks = _force(hand, random), round(0.5 * pi * length / peak * RATE_HZ)
            for tick in range(ticks):
                speed = peak * sin(pi * (tick + 0.5) / ticks)
                yield Intent(speed, force, 0.0, heading)
            heading += pi + float(random.normal(0.0, 0.05))


def pauses(hand: Hand, random: np.random.Generator, place: Place) -> Iterator[Intent]:
    """Stroke as `quick` does, and rest for 0.3 to 3 s after each, on the surface or above."""
    aim = HeadingPlanner(hand, random)
    while True:
        yield from _stroke(hand, random, aim, place)
        ticks = int(random.integers(300, 3000))
        if random.random() < 0.5:
            yield from _lift(random, (ticks, ticks + 1))
        else:
            force = _force(hand, random)
            yield from (Intent(0.0, force) for _ in range(ticks))


def followed(path: "RecordedPath", place: Place) -> Iterator[Intent]:
    """Follow a recorded path and its force from where the hand is, to and fro without end."""
    x_mm, y_mm = place()
    path_mm = path.position_mm[:, :2] - path.position_mm[0, :2] + (x_mm, y_mm)
    rows = np.column_stack([path_mm, path.force_n]).tolist()
    for sample in path.endless():
        wanted_x, wanted_y, force = rows[sample]
        x_mm, y_mm = place()
        u, v = (wanted_x - x_mm) * RATE_HZ, (wanted_y - y_mm) * RATE_HZ
        yield Intent(hypot(u, v), force, 0.0, atan2(v, u))


KINDS: Final[Mapping[str, Motion]] = MappingProxyType(
    {each.__name__: each for each in (quick, circles, taps, scratching, pauses)}
)
"""The kinds of hand other than `strokes`, by name."""


def _speed(hand: Hand, random: np.random.Generator) -> float:
    return float(random.uniform(hand.slowest_mm_s, hand.fastest_mm_s))


def _force(hand: Hand, random: np.random.Generator) -> float:
    return float(random.uniform(hand.lightest_n, hand.strongest_n))


def _stroke(
    hand: Hand, random: np.random.Generator, aim: HeadingPlanner, place: Place
) -> Iterator[Intent]:
    """Yield a stroke whose speed is a trapezoid, short enough for the workspace."""
    x_mm, y_mm = place()
    speed, force = _speed(hand, random), _force(hand, random)
    longest = (REACH_MM + hypot(x_mm, y_mm)) / (speed * (1.0 - _RAMP_SHARE)) * RATE_HZ
    ticks = min(int(random.integers(250, 700)), int(longest))
    heading: float | None = aim(x_mm, y_mm, speed * (1.0 - _RAMP_SHARE) * ticks * PERIOD_S)
    ramp = _RAMP_SHARE * ticks
    for tick in range(ticks):
        share = min(1.0, (tick + 0.5) / ramp, (ticks - tick - 0.5) / ramp)
        yield Intent(speed * share, force, 0.0, heading)
        heading = None


def _lift(random: np.random.Generator, ticks: tuple[int, int] = (200, 450)) -> Iterator[Intent]:
    """Yield a lift-off, 3 to 8 mm high, that lasts from `ticks[0]` up to `ticks[1]` ticks."""
    length, height = int(random.integers(*ticks)), float(random.uniform(3.0, 8.0))
    for tick in range(length):
        yield Intent(0.0, 0.0, height * sin(pi * (tick + 1) / (length + 1)))


def _low_passed(intents: Iterator[Intent]) -> Iterator[Intent]:
    share = 1.0 - exp(-2.0 * pi * FORCE_BAND_HZ * PERIOD_S)
    force = 0.0
    for speed, wanted, clearance, heading, turn in intents:
        force += share * (wanted - force)
        yield Intent(speed, force, clearance, heading, turn)
