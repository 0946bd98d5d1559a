"""Contact and the loop over a delay: what holds, theory, and that a fault would be seen."""

import dataclasses
import math

import numpy as np
import pytest
from extreme_cases import those_that_do_not_hold

from mmt.contact.steps import Drive
from mmt.testing.simulation.robot import DISSIPATION_S_M, tip_drive
from mmt_lab.stability.families import contact, loop
from mmt_lab.stability.families.contact import impact_growth, wall
from mmt_lab.stability.families.loop import run_loop, stability_loop
from mmt_lab.stability.integrators import INTEGRATORS
from mmt_lab.stability.loop_theory import LIGHT_GRIP, Loop

LIGHT = Drive(0.01, 0.0, 0.0)


def test_contact_holds():
    cases = contact.cases(stiffnesses=(1e4, 1e7), map_points=6)
    assert those_that_do_not_hold("contact", cases) == []


def test_what_is_wrongly_offered_as_safe_does_not_hold(monkeypatch):
    praised = dataclasses.replace(INTEGRATORS["semi-implicit Euler"], safe=True)
    monkeypatch.setattr(contact, "INTEGRATORS", {praised.name: praised})
    impacts = contact.cases(stiffnesses=(1e5,))[0]
    assert "semi-implicit" in impacts.what
    assert not impacts.run().held


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_a_theory_that_is_off_does_not_hold(factor, monkeypatch):
    true = INTEGRATORS["explicit Euler"]
    off = dataclasses.replace(true, limit_s=lambda d, w: factor * true.limit_s(d, w))
    monkeypatch.setattr(contact, "INTEGRATORS", {off.name: off})
    limits = next(c for c in contact.cases(stiffnesses=(1e4,)) if "sustained" in c.what)
    assert not limits.run().held


def test_growth_is_seen_where_it_is_known():
    """One explicit step into the wall stores k (v h)^2 / 2 and takes nothing from the speed."""
    step_s, law = 1e-3, wall(0.01, 1e4, 0.0)
    growth = impact_growth(INTEGRATORS["explicit Euler"], LIGHT, law, step_s, 0.0)
    assert growth > 1e4 * step_s**2 / 0.01 * 0.99
    assert impact_growth(INTEGRATORS["discrete gradient"], LIGHT, law, step_s, 0.3) < 1e-12


def poles_with_delay(loop, delay_s):
    """Return the loop's poles with an eighth-order Pade approximant of the delay."""
    order = 8
    share = [
        math.factorial(2 * order - j)
        * math.factorial(order)
        / (math.factorial(2 * order) * math.factorial(j) * math.factorial(order - j))
        for j in range(order + 1)
    ]
    late = np.array([share[j] * (-delay_s) ** j for j in range(order, -1, -1)])
    early = np.array([share[j] * delay_s**j for j in range(order, -1, -1)])
    drive, pole = tip_drive(loop.bandwidth_hz)
    damping = DISSIPATION_S_M * loop.contact_n
    top = drive.stiffness_n_m * pole * np.array([damping, loop.wall_n_m])
    arm = [
        drive.mass_kg,
        drive.damping_n_s_m + damping,
        drive.stiffness_n_m + loop.wall_n_m,
    ]
    hand = [loop.hand.mass_kg, loop.hand.damping_n_s_m, loop.hand.stiffness_n_m]
    bottom = np.polymul(np.polymul(arm, hand), [1.0, pole])
    return np.roots(np.polyadd(np.polymul(top, late), np.polymul(bottom, early)))


@pytest.mark.parametrize("wall_n_m", [400.0, 700.0, 2000.0, 10_000.0])
def test_the_critical_delay_is_where_a_pole_crosses(wall_n_m):
    loop = Loop(LIGHT_GRIP, 15.0, wall_n_m, 1.0)
    critical_s = loop.critical_delay_s() + 1e-3
    assert poles_with_delay(loop, 0.99 * critical_s).real.max() < 0.0
    assert poles_with_delay(loop, 1.01 * critical_s).real.max() > 0.0


def test_a_soft_wall_is_stable_for_every_delay():
    assert math.isinf(stability_loop(0.2).critical_delay_s())
    assert run_loop(0.2, 100, 100, 4.0) < 1.0


def test_a_loop_without_any_delay_may_be_unstable():
    loose = Loop(Drive(0.1, 300.0, 2.0), 15.0, 5000.0, 1.0)
    assert loose.critical_delay_s() < 0.0
    assert poles_with_delay(loose, 1e-3).real.max() > 0.0


def test_the_loop_holds():
    cases = loop.cases(
        walls_n_mm=(0.2, 1.0, 10.0),
        delays_ms=(0, 5, 50),
        method_walls_n_mm=(50.0,),
        method_delays_ms=(100,),
    )
    assert those_that_do_not_hold("loop", cases) == []


def test_another_theory_does_not_hold(monkeypatch):
    firm = dataclasses.replace(LIGHT_GRIP, stiffness_n_m=450.0)
    monkeypatch.setattr(
        loop, "stability_loop", lambda wall: dataclasses.replace(stability_loop(wall), hand=firm)
    )
    cases = loop.cases(walls_n_mm=(1.0,), delays_ms=(13, 50))
    assert not cases[0].run().held
    assert not cases[-1].run().held
