"""Stiff contact: the safe integrator never gains energy, and the others break as theory says."""

import math
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Final

import numpy as np

from mmt.contact.steps import ContactLaw, Drive
from mmt.evaluation.reports.document import Picture
from mmt.evaluation.reports.report_files import picture
from mmt_lab.stability.families import CaseResult, Extreme, Family, Figures
from mmt_lab.stability.integrators import INTEGRATORS, Integrator, total_energy_j

STIFFNESSES_N_M: Final = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7)
MASSES_KG: Final = (0.001, 0.01, 0.1, 1.0)
RATIOS: Final = (0.0, 0.01, 0.1, 1.0)
"""Damping over critical damping."""

STEPS_S: Final = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3)
IMPACT_M_S: Final = 0.5
MAP_MASS_KG, MAP_RATIO = 0.1, 0.1

_MAP_LEAST_STEP_S: Final = 5e-5
_TOUCHES: Final = (0.0, 0.3, 0.7, 0.95)
"""Shares of a step after which the surface is met."""

_SLOW_RATIO: Final = 0.01
"""Damping ratio that is too small for a run beside the limit to show growth or decay."""

_MOST_STEPS: Final = 5000
_SUSTAINED_STEPS: Final = 4000
_RUNAWAY: Final = 1e9
_ROUNDING: Final = 1e-12


def cases(
    *, stiffnesses: tuple[float, ...] = STIFFNESSES_N_M, map_points: int = 24
) -> list[Extreme]:
    """Return the family's cases."""
    impacts = len(MASSES_KG) * len(RATIOS) * len(STEPS_S) * len(_TOUCHES)
    return [
        *(
            Extreme(
                f"{way.name}, {impacts} impacts on {stiffness:,.0f} N/m",
                "energy never grows" if way.safe else "grows (not offered as safe)",
                partial(_impacts, way, stiffness),
            )
            for way, stiffness in product(INTEGRATORS.values(), stiffnesses)
        ),
        *(
            Extreme(
                f"{way.name}, sustained contact with {stiffness:,.0f} N/m",
                "breaks at the theoretical step, to 0.1 %",
                partial(_limits, way, stiffness),
            )
            for way, stiffness in product(INTEGRATORS.values(), stiffnesses)
            if not way.safe
        ),
        Extreme(
            f"energy map, {MAP_MASS_KG:g} kg, {MAP_RATIO:g} of critical damping",
            "growth only where not offered as safe",
            partial(_map, map_points),
        ),
    ]


def wall(mass_kg: float, stiffness_n_m: float, ratio: float) -> ContactLaw:
    """Return a wall with a share of the critical damping for this mass."""
    return ContactLaw(stiffness_n_m, 2.0 * ratio * math.sqrt(stiffness_n_m * mass_kg))


def impact_growth(
    way: Integrator, drive: Drive, law: ContactLaw, step_s: float, touch: float
) -> float:
    """Return the largest growth of energy in an impact at 0.5 m/s, as a share of that at start.

    Growth counts from the lowest energy so far. The free tool meets the surface after the share
    `touch` of a step, and is followed until it has left or runs away.
    """
    state = (touch * IMPACT_M_S * step_s, -IMPACT_M_S)
    start = lowest = total_energy_j(drive, law, state)
    growth = 0.0
    for _ in range(_MOST_STEPS):
        state = way.step(drive, law, state, 0.0, step_s)[:2]
        energy = total_energy_j(drive, law, state)
        growth = max(growth, (energy - lowest) / start)
        lowest = min(lowest, energy)
        if growth > _RUNAWAY or min(state) > 0.0:
            break
    return growth


def _worst(way: Integrator, drive: Drive, law: ContactLaw, step_s: float) -> float:
    return max(impact_growth(way, drive, law, step_s, touch) for touch in _TOUCHES)


def _impacts(way: Integrator, stiffness: float) -> CaseResult:
    worst, where = 0.0, ""
    for mass, ratio, step_s in product(MASSES_KG, RATIOS, STEPS_S):
        drive, law = Drive(mass, 0.0, 0.0), wall(mass, stiffness, ratio)
        growth = _worst(way, drive, law, step_s)
        if growth > worst:
            worst = growth
            where = f" ({1e3 * mass:g} g, damping {ratio:g}, {1e3 * step_s:g} ms)"
    return CaseResult(
        f"grows by {_share(worst)}{where if worst > _ROUNDING else ''}",
        held=worst <= _ROUNDING if way.safe else worst > _ROUNDING,
        figures={"growth": worst},
    )


def _share(growth: float) -> str:
    if growth <= _ROUNDING:
        return f"{growth:.0e}, a rounding"
    return f"over {_RUNAWAY:.0e} x" if growth > _RUNAWAY else f"{growth:.2g} x"


def _limits(way: Integrator, stiffness: float) -> CaseResult:
    """Compare the step at which sustained contact breaks with theory, and try steps beside it."""
    worst, text, wrong_runs = 0.0, "", 0
    for mass, ratio in product(MASSES_KG, RATIOS):
        drive, law = Drive(mass, 0.1 * stiffness, 0.0), wall(mass, stiffness, ratio)
        theory_s = way.limit_s(drive, law)
        if theory_s == 0.0:
            wrong_runs += _radius(way, drive, law, 1e-3 * math.sqrt(mass / stiffness)) <= 1.0
            continue
        measured_s = _breaking_step(way, drive, law, theory_s)
        worst = max(worst, abs(measured_s / theory_s - 1.0))
        if ratio != _SLOW_RATIO:
            wrong_runs += not _stays(way, drive, law, 0.9 * theory_s)
            wrong_runs += _stays(way, drive, law, 1.1 * theory_s)
        if (mass, ratio) == (MAP_MASS_KG, MAP_RATIO):
            text = f"{1e3 * measured_s:.4g} ms, theory {1e3 * theory_s:.4g} ms (100 g, 0.1)"
    undamped = "; none without damping" if way.limit_s(drive, ContactLaw(stiffness)) == 0.0 else ""
    return CaseResult(
        f"{text}{undamped}; all to {worst:.0e}, runs beside it agree"
        if not wrong_runs
        else f"{text}; {wrong_runs} runs disagree",
        held=worst < 1e-3 and not wrong_runs,
        figures={"largest_difference": worst, "runs_that_disagree": wrong_runs},
    )


def _radius(way: Integrator, drive: Drive, law: ContactLaw, step_s: float) -> float:
    """Return the spectral radius of one step in contact, from three runs of it.

    All start far inside the wall, where the step is linear; velocities are scaled to lengths.
    """
    scale = math.sqrt((drive.stiffness_n_m + law.stiffness_n_m) / drive.mass_kg)
    base = np.array(way.step(drive, law, (-1.0, 0.0), 0.0, step_s)[:2])
    deeper = np.array(way.step(drive, law, (-1.25, 0.0), 0.0, step_s)[:2])
    faster = np.array(way.step(drive, law, (-1.0, -0.03125 * scale), 0.0, step_s)[:2])
    step = np.column_stack([(base - deeper) / 0.25, (base - faster) / 0.03125])
    step[1] /= scale
    return float(np.abs(np.linalg.eigvals(step)).max())


def _breaking_step(way: Integrator, drive: Drive, law: ContactLaw, near_s: float) -> float:
    """Return the step at which the spectral radius reaches one, by bisection."""
    low, high = 0.5 * near_s, 2.0 * near_s
    for _ in range(40):
        middle = 0.5 * (low + high)
        if _radius(way, drive, law, middle) <= 1.0 + 1e-9:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _stays(way: Integrator, drive: Drive, law: ContactLaw, step_s: float) -> bool:
    """Return whether pressed contact, disturbed by a thousandth, stays within a tenth."""
    command = -1e-3
    rest = command * drive.stiffness_n_m / (drive.stiffness_n_m + law.stiffness_n_m)
    state = (1.001 * rest, 0.0)
    for _ in range(_SUSTAINED_STEPS):
        state = way.step(drive, law, state, command, step_s)[:2]
        if abs(state[0] / rest - 1.0) > 0.1:
            return False
    return True


def _map(points: int) -> CaseResult:
    """Return the growth of impacts over step and stiffness, for each integrator."""
    steps_s = np.geomspace(_MAP_LEAST_STEP_S, STEPS_S[-1], points)
    stiffness = np.geomspace(STIFFNESSES_N_M[0], STIFFNESSES_N_M[-1], points)
    drive = Drive(MAP_MASS_KG, 0.0, 0.0)
    walls = [wall(MAP_MASS_KG, k, MAP_RATIO) for k in stiffness.tolist()]
    growth = {
        name: np.array([[_worst(way, drive, law, step) for step in steps_s] for law in walls])
        for name, way in INTEGRATORS.items()
    }
    limits = {
        name: [way.limit_s(drive, law) for law in walls]
        for name, way in INTEGRATORS.items()
        if not way.safe
    }
    calm = [name for name, grown in growth.items() if grown.max() <= _ROUNDING]
    return CaseResult(
        f"no growth with: {', '.join(calm) or 'none'}",
        held=calm == [name for name, way in INTEGRATORS.items() if way.safe],
        figures={
            "step_s": steps_s.tolist(),
            "stiffness_n_m": stiffness.tolist(),
            "growth": {name: grown.tolist() for name, grown in growth.items()},
            "limit_s": limits,
        },
    )


def _pictures(figures: Sequence[Figures]) -> list[Picture]:
    """Draw the energy map, if it ran."""
    from mmt_lab.stability.maps import contact_map

    caption = (
        f"Impacts of {1e3 * MAP_MASS_KG:g} g at 0.5 m/s on walls with {MAP_RATIO:g} of critical "
        "damping: by how much the energy grows above what was there before. Dashed: where "
        "sustained contact becomes unstable."
    )
    return [picture("contact", caption, contact_map(row)) for row in figures if "limit_s" in row]


FAMILY: Final = Family("Stiff contact", cases, _pictures)
