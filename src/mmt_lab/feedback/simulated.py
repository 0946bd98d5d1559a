"""A hand, a link and a follower on a wall in a closed loop, in which instability can show.

The loop has `SimulatedRobot` and both sides of the method as in the services, a handle in a hand
(a mass, and a damper and a spring to a moving target), and delay lines that keep the order. The
hand touches, lets go, touches again, presses to and fro and rests:

======== =====================================================================
0.3 s    first touch, 5 mm below the surface, which a light grip makes 1.5 N
1.3 s    away again
2.3 s    second touch
2.8 s    two strokes of 1 Hz, 2.5 to 7.5 mm below
4.8 s    rest, to the end at 6.5 s
======== =====================================================================
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

import numpy as np

from mmt.contact.steps import Drive, step_tangential
from mmt.core.arrays import FloatArray, RecordArray, Vector
from mmt.core.frames import empty_frames
from mmt.evaluation.model_errors import root_mean_square
from mmt.scene import Simulated
from mmt.testing.simulation import PERIOD_S, START_MM
from mmt.testing.simulation.robot import SimulatedRobot
from mmt_lab.feedback.sides import PASSIVITY, Display, Method, handle_state, make_sides
from mmt_lab.stability.loop_theory import LIGHT_GRIP

WALLS_N_MM: Final = (0.1, 0.5, 2.0, 10.0, 50.0)
DELAYS_MS: Final = (0, 10, 50, 100, 200)
"""Mean delays one way; the way back takes as long."""

JITTER: Final = 0.25
"""Largest deviation of a delay from its mean, over the mean."""
LIMIT_N: Final = 10.0
DURATION_S: Final = 6.5
SECOND_TOUCH_S: Final = 2.3
REST_S: Final = 0.75
REST_SPEED_MM_S: Final = 2.0
"""The loop is stable if the hand moves more slowly than this while it should rest."""

_DEPTH_M: Final = 5e-3
_CLEAR_M: Final = 5e-3
_STROKE_M: Final = 2.5e-3
_RAMP_S: Final = 0.5


@dataclass(frozen=True)
class CellResult:
    """Result of a method on a wall with a delay.

    Attributes
    ----------
    method, wall_n_mm, delay_ms
        The cell; the delay is one way.
    rest_speed_mm_s
        Root mean square of the handle's speed over the last 0.75 s, when the hand rests.
    injected_mj
        Largest energy that the hand had received beyond what it had put in, at any time.
    force_error_n
        Root mean square, from the second touch on, of the displayed force less the surface's
        force on the tool when the hand's present motion has reached the tool.
    position_error_mm
        The same for the position of the handle less that of the tool.
    """

    method: Method
    wall_n_mm: float
    delay_ms: int
    rest_speed_mm_s: float
    injected_mj: float
    force_error_n: float
    position_error_mm: float

    @property
    def stable(self) -> bool:
        """Whether the hand came to rest."""
        return self.rest_speed_mm_s < REST_SPEED_MM_S

    @property
    def passive(self) -> bool:
        """Whether the hand received no more energy than it put in plus the reserve."""
        return self.injected_mj <= 1e3 * PASSIVITY.reserve_j * (1.0 + 1e-6)


class HeldHandle(Display):
    """A handle with a mass, held to the hand's target by a spring and a damper."""

    def __init__(self, drive: Drive, height_m: float, speed_m_s: float = 0.0) -> None:
        super().__init__()
        self._drive = drive
        self.height_m, self.speed_m_s = height_m, speed_m_s
        self._net_j = 0.0
        self.injected_j = 0.0

    def move(self, target_m: float) -> None:
        """Move for a tick under the force that was written last, and count its work."""
        before_m = self.height_m
        centre_m = target_m + self.force_n / self._drive.stiffness_n_m
        state = (before_m, self.speed_m_s)
        moved = step_tangential(self._drive, 0.0, state, centre_m, PERIOD_S)
        self.height_m, self.speed_m_s = moved[0], moved[1]
        self._net_j += self.force_n * (self.height_m - before_m)
        self.injected_j = max(self.injected_j, self._net_j)


def run_cell(
    method: Method, wall_n_mm: float, delay_ms: int, seed: int = 0, *, hand: Drive = LIGHT_GRIP
) -> CellResult:
    """Run a method on a wall with a delay and jitter."""
    holder = HeldHandle(hand, _CLEAR_M)
    log = _run(method, wall_n_mm, delay_ms, seed, holder)
    heights, speeds, shown, tips, forces = log.T
    late = len(log) - delay_ms
    learned = slice(round(SECOND_TOUCH_S / PERIOD_S), late)
    same = slice(learned.start + delay_ms, None)
    return CellResult(
        method,
        wall_n_mm,
        delay_ms,
        rest_speed_mm_s=1e3 * root_mean_square(speeds[-round(REST_S / PERIOD_S) :]),
        injected_mj=1e3 * holder.injected_j,
        force_error_n=root_mean_square(shown[learned] - forces[same]),
        position_error_mm=1e3 * root_mean_square(heights[learned] - tips[same]),
    )


def _run(
    method: Method, wall_n_mm: float, delay_ms: int, seed: int, holder: HeldHandle
) -> FloatArray:
    """Return handle height, speed, displayed force, tool height and its force, (n, 5), SI."""
    sides = make_sides(method, holder, limit_n=LIMIT_N)
    robot = SimulatedRobot(Simulated(surface_stiffness_n_mm=wall_n_mm), 0.0)
    jitter = round(JITTER * delay_ms)
    commands: DelayLine[Vector] = DelayLine(delay_ms, jitter, 4 * seed)
    frames, down, up = (
        DelayLine[RecordArray](delay_ms, jitter, 4 * seed + number) for number in (1, 2, 3)
    )
    wanted: Vector | None = None
    log = np.zeros((round(DURATION_S / PERIOD_S), 5))
    for tick in range(len(log)):
        holder.move(_target_m(tick * PERIOD_S))
        state = handle_state(holder.height_m, holder.speed_m_s)
        commands.push(tick, state.position_mm)
        for frame in frames.pop(tick):
            sides.leader.on_frames(frame)
        for records in up.pop(tick):
            sides.leader.on_records(records)
        news = sides.leader.tick(1, state)
        if news is not None:
            down.push(tick, news)
        for position_mm in commands.pop(tick):
            wanted = position_mm
        command = wanted
        if sides.follower is not None:
            for records in down.pop(tick):
                sides.follower.on_records(records)
            command = sides.follower.command(wanted)
        tip = robot.advance(START_MM if command is None else command)
        frame = empty_frames(1, ("position", "force"))
        frame["sequence"] = tick
        frame["position_mm"], frame["force_n"] = tip.position_mm, tip.force_n
        frames.push(tick, frame)
        reply = sides.follower.measured(frame) if sides.follower is not None else None
        if reply is not None:
            up.push(tick, reply)
        tool = 1e-3 * tip.position_mm[2], tip.force_n[2]
        log[tick] = (holder.height_m, holder.speed_m_s, holder.force_n, *tool)
    return log


def _target_m(time_s: float) -> float:
    """Return the height of the hand's target."""
    pressed = _ramp(time_s, 0.3) - _ramp(time_s, 1.3) + _ramp(time_s, SECOND_TOUCH_S)
    height_m = _CLEAR_M - (_CLEAR_M + _DEPTH_M) * pressed
    if 2.8 < time_s < 4.8:
        height_m -= _STROKE_M * math.sin(2.0 * math.pi * (time_s - 2.8))
    return height_m


def _ramp(time_s: float, start_s: float) -> float:
    share = min(1.0, max(0.0, (time_s - start_s) / _RAMP_S))
    return 0.5 - 0.5 * math.cos(math.pi * share)


Item = TypeVar("Item")


class DelayLine(Generic[Item]):
    """Deliver items in their order, each with its own delay.

    As on a link over TCP, no item arrives before the items that were sent ahead of it.
    """

    def __init__(self, delay_ticks: int, jitter_ticks: int, seed: int) -> None:
        self._delay = delay_ticks
        self._jitter = min(jitter_ticks, delay_ticks)
        self._rng = np.random.default_rng(seed)
        self._waiting: deque[tuple[int, Item]] = deque()
        self._latest = 0

    def push(self, tick: int, item: Item) -> None:
        """Send an item at a tick."""
        off = int(self._rng.integers(-self._jitter, self._jitter + 1)) if self._jitter else 0
        self._latest = max(self._latest, tick + self._delay + off)
        self._waiting.append((self._latest, item))

    def pop(self, tick: int) -> list[Item]:
        """Return the items that have arrived up to a tick, since the last call."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= tick:
            arrived.append(self._waiting.popleft()[1])
        return arrived
