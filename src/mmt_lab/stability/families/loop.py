"""Force feedback over a delay: leader's and follower's parts in a loop, compared with theory."""

import math
from collections import deque
from collections.abc import Sequence
from functools import partial
from typing import Final

from mmt.core.frames import empty_frames
from mmt.evaluation.reports.document import Picture
from mmt.evaluation.reports.report_files import picture
from mmt.leader.motion.feedback import StreamedForce
from mmt.scene import Simulated
from mmt.testing.simulation.robot import SimulatedRobot, tip_drive
from mmt_lab.feedback import simulated
from mmt_lab.feedback.sides import PASSIVITY, Method
from mmt_lab.stability.families import CaseResult, Extreme, Family, Figures
from mmt_lab.stability.loop_theory import BANDWIDTH_HZ, CONTACT_N, LIGHT_GRIP, critical_delay_s

WALLS_N_MM: Final = (0.1, 0.2, 0.3, 0.4, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
DELAYS_MS: Final = (0, 1, 2, 5, 10, 20, 50, 100, 200)
"""One way."""


_LONGEST_MS: Final = 400
_KICK_M_S: Final = 2e-3
_GONE_N: Final = 0.5
_LIMIT_N: Final = 3.3
_METHODS: Final[tuple[Method, ...]] = ("passive", "model")


def cases(
    *,
    walls_n_mm: tuple[float, ...] = WALLS_N_MM,
    delays_ms: tuple[int, ...] = DELAYS_MS,
    method_walls_n_mm: tuple[float, ...] = simulated.WALLS_N_MM,
    method_delays_ms: tuple[int, ...] = simulated.DELAYS_MS,
) -> list[Extreme]:
    """Return the family's cases."""
    return [
        *(
            Extreme(
                f"hand, link and follower on {wall:g} N/mm, force streamed back",
                _theory(wall),
                partial(_boundary, wall),
            )
            for wall in walls_n_mm
        ),
        *(
            Extreme(
                f"{method}, {delay} ms each way with jitter, on {method_walls_n_mm[0]:g} to "
                f"{method_walls_n_mm[-1]:g} N/mm",
                "hand at rest at the end, no more than "
                f"{1e3 * PASSIVITY.reserve_j:g} mJ given to it",
                partial(_over_walls, method, method_walls_n_mm, delay),
            )
            for method in _METHODS
            for delay in method_delays_ms
        ),
        Extreme(
            "map of delays against walls",
            "every point as theory says, those within 1 ms of its line left aside",
            partial(_map, walls_n_mm, delays_ms),
        ),
    ]


def _theory(wall_n_mm: float) -> str:
    critical_ms = 1e3 * critical_delay_s(wall_n_mm)
    if math.isinf(critical_ms):
        return "stable for every delay (theory)"
    return f"unstable from {critical_ms:.1f} ms there and back (theory, to 1 ms or 2 %)"


def run_loop(wall_n_mm: float, there_ms: int, back_ms: int, seconds: float) -> float:
    """Return the growth of a small disturbance of steady contact; above 1 it is unstable.

    The loop has `SimulatedRobot` and `StreamedForce` as in the services, a handle in a hand, and
    two queues for the link. The growth is the force's deviation in the last quarter of the run
    over that in the second; infinity if a deviation exceeds half the contact's force.
    """
    robot = SimulatedRobot(Simulated(surface_stiffness_n_mm=wall_n_mm), 0.0)
    drive, _ = tip_drive(BANDWIDTH_HZ)
    height_m = -CONTACT_N * (1.0 / drive.stiffness_n_m + 1e-3 / wall_n_mm)
    for _ in range(1500):
        tip = robot.advance((0.0, 0.0, 1e3 * height_m))
    steady_n = tip.force_n[2]
    handle = simulated.HeldHandle(LIGHT_GRIP, height_m, _KICK_M_S)
    target_m = height_m - steady_n / LIGHT_GRIP.stiffness_n_m
    feedback = StreamedForce(handle, limit_n=_LIMIT_N)
    frame = empty_frames(1, ("force",))
    forces = deque([steady_n] * (back_ms + 1))
    commands = deque([1e3 * height_m] * (there_ms + 1))
    ticks = round(1e3 * seconds)
    squares = [0.0] * 4
    for tick in range(ticks):
        tip = robot.advance((0.0, 0.0, commands.popleft()))
        frame["force_n"][0, 2] = forces.popleft()
        feedback.on_frames(frame)
        feedback.tick(1, None)
        handle.move(target_m)
        commands.append(1e3 * handle.height_m)
        forces.append(tip.force_n[2])
        off_n = tip.force_n[2] - steady_n
        if abs(off_n) > _GONE_N * CONTACT_N:
            return math.inf
        squares[4 * tick // ticks] += off_n * off_n
    return math.sqrt(squares[3] / squares[1])


def _grows(wall_n_mm: float, round_trip_ms: int) -> bool:
    there_ms = round_trip_ms // 2
    seconds = max(2.0, 0.04 * round_trip_ms)
    return run_loop(wall_n_mm, there_ms, round_trip_ms - there_ms, seconds) > 1.0


def _boundary(wall_n_mm: float) -> CaseResult:
    """Find the shortest round trip, in ms, at which a disturbance grows."""
    critical_ms = 1e3 * critical_delay_s(wall_n_mm)
    if not _grows(wall_n_mm, _LONGEST_MS):
        return CaseResult(
            f"dies out at {_LONGEST_MS} ms there and back",
            held=critical_ms > _LONGEST_MS,
            figures={
                "wall_n_mm": wall_n_mm,
                "theory_ms": critical_ms,
                "measured_ms": math.inf,
            },
        )
    tolerance_ms = max(1.0, 0.02 * critical_ms)
    low, high = -1, _LONGEST_MS
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _grows(wall_n_mm, middle) else (middle, high)
    return CaseResult(
        f"dies out at {low} ms, grows at {high} ms" if high else "grows without any delay",
        held=low - tolerance_ms <= critical_ms <= high + tolerance_ms,
        figures={"wall_n_mm": wall_n_mm, "theory_ms": critical_ms, "measured_ms": float(high)},
    )


def _map(walls_n_mm: tuple[float, ...], delays_ms: tuple[int, ...]) -> CaseResult:
    critical_ms = [1e3 * critical_delay_s(wall) for wall in walls_n_mm]
    grows = [[_grows(wall, 2 * delay) for wall in walls_n_mm] for delay in delays_ms]
    wrong = [
        (wall, delay)
        for delay, row in zip(delays_ms, grows, strict=True)
        for wall, critical, grown in zip(walls_n_mm, critical_ms, row, strict=True)
        if abs(2 * delay - critical) > 1.0 and grown != (2 * delay > critical)
    ]
    unstable = sum(map(sum, grows))
    return CaseResult(
        f"{unstable} of {len(walls_n_mm) * len(delays_ms)} unstable, {len(wrong)} not as theory"
        + "".join(f", {wall:g} N/mm at {delay} ms" for wall, delay in wrong[:3]),
        held=not wrong,
        figures={
            "wall_n_mm": list(walls_n_mm),
            "delay_ms": list(delays_ms),
            "grows": grows,
            "critical_ms": critical_ms,
        },
    )


def _over_walls(method: Method, walls_n_mm: tuple[float, ...], delay_ms: int) -> CaseResult:
    cells = [simulated.run_cell(method, wall, delay_ms) for wall in walls_n_mm]
    rest_mm_s = max(cell.rest_speed_mm_s for cell in cells)
    injected_mj = max(cell.injected_mj for cell in cells)
    return CaseResult(
        f"{rest_mm_s:.2g} mm/s and {injected_mj:.2f} mJ at most",
        held=all(cell.stable and cell.passive for cell in cells),
        figures={
            "method": method,
            "delay_ms": delay_ms,
            "wall": list(walls_n_mm),
            "rest_speed_mm_s": [cell.rest_speed_mm_s for cell in cells],
            "injected_mj": [cell.injected_mj for cell in cells],
            "force_error_n": [cell.force_error_n for cell in cells],
            "position_error_mm": [cell.position_error_mm for cell in cells],
        },
    )


def _pictures(figures: Sequence[Figures]) -> list[Picture]:
    """Draw the map of delays against walls, if it ran, with the boundaries that were found."""
    from mmt_lab.stability.maps import loop_map

    boundaries = [row for row in figures if {"wall_n_mm", "measured_ms"} <= set(row)]
    caption = (
        "Force feedback over a delay, a light grip on the handle: where a small disturbance of "
        "steady contact dies out and where it grows, beside linear theory (shaded)."
    )
    return [
        picture("loop", caption, loop_map(row, boundaries)) for row in figures if "grows" in row
    ]


FAMILY: Final = Family("Force feedback over a delay", cases, _pictures)
