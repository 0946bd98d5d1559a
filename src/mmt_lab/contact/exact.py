"""The contact step that solves each linear phase in closed form and locates its end.

With a Kelvin-Voigt wall the motion is linear in three phases: above the surface; in contact,
``F = k d + c d' > 0``; and below the surface but parted from it, where the law would pull and
so is zero. Each phase is solved exactly, whatever its damping. It ends at the first zero of a
linear function of height and velocity, which is sought between that function's extremes:
these have a closed form too, so that no zero is missed however long the step is (event
location: Shampine and Thompson, Comput. Math. Appl. 39 (2000), 43-54).

Stability: the exact flow, hence energy never grows while the command stands still. Cost: some
5 us a step without an event and 20 us an event in plain Python.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from mmt.contact.normal import ContactLaw, Drive
from mmt.core.errors import InputError

_MOST_HALVINGS: Final = 80


class _Phase(Enum):
    ABOVE = auto()
    CONTACT = auto()
    PARTED = auto()


@dataclass(frozen=True, slots=True)
class _Function:
    """A linear function of height and velocity, ``height * x + velocity * v``."""

    height: float
    velocity: float

    def at(self, state: tuple[float, float]) -> float:
        return self.height * state[0] + self.velocity * state[1]


@dataclass(frozen=True, slots=True)
class _Motion:
    """The solution of ``x'' + 2 s x' + w^2 (x - centre) = 0`` from a state."""

    square: float
    decay: float
    centre: float
    height: float
    velocity: float

    def state(self, time_s: float) -> tuple[float, float]:
        """Return height and velocity after a time."""
        cosine, sine = self._pair(time_s)
        offset = self.height - self.centre
        turn = self.decay * sine
        return (
            self.centre + offset * (cosine + turn) + self.velocity * sine,
            self.velocity * (cosine - turn) - self.square * offset * sine,
        )

    def extremes(self, function: _Function, until_s: float) -> Iterator[float]:
        """Yield the times up to `until_s`, ascending, at which a function turns; at last it."""
        acceleration = self._acceleration(self.height - self.centre, self.velocity)
        jerk = self._acceleration(self.velocity, acceleration)
        slope = function.height * self.velocity + function.velocity * acceleration
        bend = function.height * acceleration + function.velocity * jerk
        # The slope at time t is slope * C + (slope * s + bend) * S.
        across = slope * self.decay + bend
        distance = self.decay * self.decay - self.square
        if distance < 0.0:
            rate = math.sqrt(-distance)
            time_s = math.atan2(-slope * rate, across) % math.pi / rate
            while time_s < until_s:
                if time_s > 0.0:
                    yield time_s
                time_s += math.pi / rate
        elif slope * across < 0.0:
            rate = math.sqrt(distance)
            ratio = -slope * rate / across
            if ratio < 1.0:
                time_s = math.atanh(ratio) / rate if rate > 0.0 else -slope / across
                if 0.0 < time_s < until_s:
                    yield time_s
        yield until_s

    def _acceleration(self, offset: float, velocity: float) -> float:
        return -2.0 * self.decay * velocity - self.square * offset

    def _pair(self, time_s: float) -> tuple[float, float]:
        """Return ``exp(-s t) cosh(b t)`` and ``exp(-s t) sinh(b t) / b``, b^2 = s^2 - w^2."""
        distance = self.decay * self.decay - self.square
        if distance < 0.0:
            rate, shrunk = math.sqrt(-distance), math.exp(-self.decay * time_s)
            angle = rate * time_s
            return shrunk * math.cos(angle), shrunk * math.sin(angle) / rate
        rate = math.sqrt(distance)
        slow = self.square / (self.decay + rate) if self.decay > 0.0 else 0.0
        shrunk = 0.5 * math.exp(-slow * time_s)
        gone = math.expm1(-2.0 * rate * time_s)
        sine = -shrunk * gone / rate if rate * time_s > 1e-150 else 2.0 * shrunk * time_s
        return shrunk * (2.0 + gone), sine


def step_exact(
    drive: Drive,
    law: ContactLaw,
    state: tuple[float, float],
    command_m: float,
    step_s: float,
) -> tuple[float, float, float]:
    """Advance the tip along the normal by one step, without error but rounding.

    Arguments and results as `mmt.contact.normal.step_normal`.

    Raises
    ------
    InputError
        The law has Hunt-Crossley dissipation, which is not linear.
    """
    if law.dissipation_s_m > 0.0:
        raise InputError(
            f"dissipation_s_m is {law.dissipation_s_m}: the exact step needs a linear law, 0"
        )
    phase = _phase_of(drive, law, state, command_m)
    impulse_n_s, left_s = 0.0, step_s
    while True:
        motion = _motion(drive, law, phase, state, command_m)
        ended_s, following = _end(law, phase, motion, left_s)
        later = motion.state(ended_s)
        if phase is _Phase.CONTACT:
            impulse_n_s += _impulse(drive, law, motion, state, later, ended_s)
        if following is None:
            return later[0], later[1], max(impulse_n_s, 0.0) / step_s
        state = later
        if _Phase.ABOVE in {phase, following}:
            state = (0.0, later[1])
        phase, left_s = following, left_s - ended_s


def _phase_of(
    drive: Drive, law: ContactLaw, state: tuple[float, float], command_m: float
) -> _Phase:
    height, velocity = state
    if height < 0.0:
        force = -law.stiffness_n_m * height - law.damping_n_s_m * velocity
        return _Phase.CONTACT if force > 0.0 else _Phase.PARTED
    pushed_in = velocity == 0.0 and drive.stiffness_n_m * command_m < 0.0
    if height == 0.0 and (velocity < 0.0 or pushed_in):
        return _Phase.CONTACT
    return _Phase.ABOVE


def _motion(
    drive: Drive, law: ContactLaw, phase: _Phase, state: tuple[float, float], command_m: float
) -> _Motion:
    stiffness, damping = drive.stiffness_n_m, drive.damping_n_s_m
    centre = command_m
    if phase is _Phase.CONTACT:
        stiffness += law.stiffness_n_m
        damping += law.damping_n_s_m
        centre *= drive.stiffness_n_m / stiffness
    mass = drive.mass_kg
    return _Motion(stiffness / mass, 0.5 * damping / mass, centre, state[0], state[1])


def _end(
    law: ContactLaw, phase: _Phase, motion: _Motion, left_s: float
) -> tuple[float, _Phase | None]:
    """Return when the phase ends, at the latest after `left_s`, and what follows."""
    height = _Function(1.0, 0.0)
    force = _Function(-law.stiffness_n_m, -law.damping_n_s_m)
    if phase is _Phase.ABOVE:
        ended_s = _first_below(motion, height, left_s)
        return (left_s, None) if ended_s is None else (ended_s, _Phase.CONTACT)
    if phase is _Phase.CONTACT:
        ended_s = _first_below(motion, force, left_s)
        parted = _Phase.PARTED if law.damping_n_s_m > 0.0 else _Phase.ABOVE
        return (left_s, None) if ended_s is None else (ended_s, parted)
    surfaced_s = _first_below(motion, _Function(-1.0, 0.0), left_s)
    pressed = _Function(law.stiffness_n_m, law.damping_n_s_m)
    touched_s = _first_below(motion, pressed, left_s if surfaced_s is None else surfaced_s)
    if touched_s is not None:
        return touched_s, _Phase.CONTACT
    return (left_s, None) if surfaced_s is None else (surfaced_s, _Phase.ABOVE)


def _first_below(motion: _Motion, function: _Function, until_s: float) -> float | None:
    """Return when a function that is not below zero first falls below it, None if never."""
    before_s, before = 0.0, function.at((motion.height, motion.velocity))
    for time_s in motion.extremes(function, until_s):
        value = function.at(motion.state(time_s))
        if value < 0.0 and value < before:
            return _zero(motion, function, before_s, time_s)
        before_s, before = time_s, value
    return None


def _zero(motion: _Motion, function: _Function, low_s: float, high_s: float) -> float:
    """Return where a function falls through zero between two times, by bisection."""
    for _ in range(_MOST_HALVINGS):
        middle_s = 0.5 * (low_s + high_s)
        if not low_s < middle_s < high_s:
            break
        if function.at(motion.state(middle_s)) < 0.0:
            high_s = middle_s
        else:
            low_s = middle_s
    return high_s


def _impulse(
    drive: Drive,
    law: ContactLaw,
    motion: _Motion,
    start: tuple[float, float],
    end: tuple[float, float],
    time_s: float,
) -> float:
    """Return the wall's impulse (N s) over a phase of contact, from the momentum's balance."""
    stiffness = drive.stiffness_n_m + law.stiffness_n_m
    damping = drive.damping_n_s_m + law.damping_n_s_m
    travel, change = end[0] - start[0], end[1] - start[1]
    area = motion.centre * time_s - (drive.mass_kg * change + damping * travel) / stiffness
    return -law.stiffness_n_m * area - law.damping_n_s_m * travel
