"""The passive and the model method in the closed loop, where the streamed force goes unstable."""

from functools import partial
from typing import Final

from mmt_lab.feedback.sides import PASSIVITY, Method
from mmt_lab.feedback.simulated import run_cell
from mmt_lab.harness.cases import Case, Outcome

_METHODS: Final[tuple[Method, ...]] = ("passive", "model")


def method_cases(walls_n_mm: tuple[float, ...], delays_ms: tuple[int, ...]) -> list[Case]:
    """Return a case for each method and delay, over all walls.

    Parameters
    ----------
    walls_n_mm
        Stiffness of the walls.
    delays_ms
        Mean one-way delays, each with jitter.
    """
    reserve_mj = 1e3 * PASSIVITY.reserve_j
    return [
        Case(
            f"{method}, {delay} ms each way with jitter, on {walls_n_mm[0]:g} to "
            f"{walls_n_mm[-1]:g} N/mm",
            f"hand at rest at the end, no more than {reserve_mj:g} mJ given to it",
            partial(_over_walls, method, walls_n_mm, delay),
        )
        for method in _METHODS
        for delay in delays_ms
    ]


def _over_walls(method: Method, walls_n_mm: tuple[float, ...], delay_ms: int) -> Outcome:
    cells = [run_cell(method, wall, delay_ms) for wall in walls_n_mm]
    rest_mm_s = max(cell.rest_speed_mm_s for cell in cells)
    injected_mj = max(cell.injected_mj for cell in cells)
    return Outcome(
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
