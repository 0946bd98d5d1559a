"""Cases of a service that is held up: the robot and the force at the hand do not jump."""

import math
from functools import partial
from itertools import pairwise
from typing import Final

import numpy as np

from mmt.core.frames import COMMAND_DTYPE
from mmt.devices.protocols import Vector
from mmt.follower.command_guard import CommandGuard
from mmt.leader.motion.force_ramp import RAMP_TICKS, ForceRamp
from mmt.scene import Link
from mmt_lab.stability.cases import CaseResult, Extreme

_STALLS_MS: Final = (80, 300, 1000)
_HAND_MM: Final = 0.3
_FORCE_N: Final = 3.0


def stall_cases() -> list[Extreme]:
    """Return the cases of stalled commands, of missed ticks, and of a force over them."""
    fastest_mm = _HAND_MM + Link().recovery_mm_s / 1000
    most_n = _FORCE_N / RAMP_TICKS
    return [
        *(
            Extreme(
                f"the robot after {stall_ms} ms without commands, hand at 300 mm/s",
                f"at most {fastest_mm:g} mm a tick",
                partial(_robot, stall_ms, missed=False, most_mm=fastest_mm),
            )
            for stall_ms in _STALLS_MS
        ),
        *(
            Extreme(
                f"the robot after {stall_ms} missed ticks, hand at 300 mm/s",
                "at most 1 mm a call",
                partial(_robot, stall_ms, missed=True, most_mm=Link().limit_mm_s / 1000),
            )
            for stall_ms in _STALLS_MS
        ),
        *(
            Extreme(
                f"{_FORCE_N:g} N at the hand, a tick held up for {stall_ms} ms",
                f"at most {most_n:g} N a write",
                partial(_force, stall_ms, most_n),
            )
            for stall_ms in _STALLS_MS
        ),
    ]


def _robot(stall_ms: int, *, missed: bool, most_mm: float) -> CaseResult:
    guard = CommandGuard(Link(), 1000.0, "z", measures_position=False, say=lambda _: None)
    block = np.zeros(1, dtype=COMMAND_DTYPE)
    places: list[Vector] = []
    for tick in range(1500):
        stalled = 400 <= tick < 400 + stall_ms
        if stalled and missed:
            continue
        if not stalled:
            block["position_mm"] = (_HAND_MM * tick, 0.0, 0.0)
            block["time_ns"] = tick * 1_000_000
            guard.receive(block, 0)
        elapsed = 1 + stall_ms if missed and tick == 400 + stall_ms else 1
        place = guard.step(elapsed, lambda: None)
        if place is not None:
            places.append(place)
    step_mm = max(math.dist(*pair) for pair in pairwise(places))
    return CaseResult(f"{step_mm:.3f} mm", held=step_mm <= most_mm + 1e-4, figures={"mm": step_mm})


def _force(stall_ms: int, most_n: float) -> CaseResult:
    ramp = ForceRamp()
    ticks = [1] * 20 + [stall_ms] + [1] * 80
    forces = [ramp.shape((0.0, 0.0, _FORCE_N), elapsed)[2] for elapsed in ticks]
    for elapsed in ticks:
        ramp.renew()
        forces.append(ramp.shape((0.0, 0.0, _FORCE_N), elapsed)[2])
    step_n = float(np.abs(np.diff(forces)).max())
    return CaseResult(f"{step_n:.3f} N", held=step_n <= most_n + 1e-9, figures={"n": step_n})
