"""Every way to step a contact: closed forms, a general solver, energy, and where it breaks."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from mmt.contact.normal import ContactLaw, Drive
from mmt.core.errors import InputError
from mmt_lab.contact.exact import step_exact
from mmt_lab.contact.integrators import (
    INTEGRATORS,
    explicit_limit_s,
    semi_implicit_limit_s,
    step_explicit,
    step_semi_implicit,
    total_energy_j,
)

STIFFNESS = st.floats(2.0, 7.0).map(lambda exponent: 10.0**exponent)
MASS = st.floats(-3.0, 0.0).map(lambda exponent: 10.0**exponent)
RATIO = st.sampled_from([0.0, 1e-3, 0.1, 0.5, 1.0, 2.0])
SPRING = st.sampled_from([0.0, 700.0, 2700.0])
STEP = st.floats(1e-5, 5e-3)
FREE = Drive(0.08, 0.0, 0.0)


def wall(mass, stiffness, ratio):
    return ContactLaw(stiffness, 2.0 * ratio * math.sqrt(stiffness * mass))


@settings(max_examples=100, deadline=None)
@given(STIFFNESS, MASS, RATIO, SPRING, st.floats(0.0, 30.0), STEP, st.floats(0.01, 0.99))
def test_an_exact_step_is_its_parts_together(stiffness, mass, ratio, spring, damping, step_s, at):
    drive, law = Drive(mass, spring, damping), wall(mass, stiffness, ratio)
    command, state = -0.004, (0.0007, -0.5)
    scale = math.sqrt(stiffness / mass)
    for _ in range(20):
        whole = step_exact(drive, law, state, command, step_s)
        first = step_exact(drive, law, state, command, at * step_s)
        second = step_exact(drive, law, first[:2], command, (1.0 - at) * step_s)
        assert whole[1] == pytest.approx(second[1], abs=1e-9)
        assert whole[0] * scale == pytest.approx(second[0] * scale, abs=1e-9)
        impulse = at * first[2] + (1.0 - at) * second[2]
        assert whole[2] == pytest.approx(impulse, rel=1e-8, abs=1e-8)
        state = whole[:2]


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.4, 1.0])
@pytest.mark.parametrize("spring", [0.0, 2700.0])
def test_an_exact_step_agrees_with_a_general_solver(ratio, spring):
    drive, law = Drive(0.08, spring, 20.0 if spring else 0.0), wall(0.08, 20_000.0, ratio)
    command, state = -0.002, (0.0004, -0.5)

    def slope(_, y):
        depth, rate = -y[0], -y[1]
        push = law.stiffness_n_m * depth + law.damping_n_s_m * rate
        force = max(0.0, push) if depth > 0.0 else 0.0
        force += drive.stiffness_n_m * (command - y[0]) - drive.damping_n_s_m * y[1]
        return [y[1], force / drive.mass_kg]

    solution = solve_ivp(
        slope, (0.0, 0.02), state, method="DOP853", rtol=1e-9, atol=1e-12, max_step=1e-5
    )
    height, velocity, _ = step_exact(drive, law, state, command, 0.02)
    assert height == pytest.approx(solution.y[0, -1], abs=3e-7)
    assert velocity == pytest.approx(solution.y[1, -1], abs=3e-5)


@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.1, 0.3, 0.6])
def test_rebound_of_a_damped_impact(ratio):
    """Schwager and Poschel, Granular Matter 9 (2007), eq. 21: no force after it reaches zero."""
    law = wall(0.08, 1e5, ratio)
    natural = math.sqrt(1e5 / 0.08)
    decay, rate = ratio * natural, natural * math.sqrt(1.0 - ratio * ratio)
    angle = math.pi - math.atan2(2.0 * decay * rate, rate * rate - decay * decay)
    _, velocity, force = step_exact(FREE, law, (0.001, -0.5), 0.0, 0.02)
    restitution = math.exp(-decay / rate * angle)
    assert velocity == pytest.approx(0.5 * restitution, rel=1e-12)
    assert force == pytest.approx(0.08 * 0.5 * (1.0 + restitution) / 0.02, rel=1e-12)


def test_at_rest_on_the_surface_under_a_push():
    drive, law = Drive(0.08, 1000.0, 30.0), ContactLaw(1e4, 50.0)
    state = (0.0, 0.0)
    for _ in range(400):
        *state, force = step_exact(drive, law, tuple(state), -0.002, 1e-3)
    series = 1e3 * 1e4 / (1e3 + 1e4)
    assert force == pytest.approx(series * 0.002, rel=1e-9)


@pytest.mark.parametrize("name", [name for name, way in INTEGRATORS.items() if way.safe])
@settings(max_examples=80, deadline=None)
@given(STIFFNESS, MASS, RATIO, SPRING, STEP, st.floats(0.0, 1.0))
def test_what_is_offered_as_safe_never_gains_energy(
    name, stiffness, mass, ratio, spring, step_s, share
):
    drive, law = Drive(mass, spring, 0.0), wall(mass, stiffness, ratio)
    command, state = -0.002, (share * 0.5 * step_s, -0.5)
    start = energy = total_energy_j(drive, law, state, command)
    for _ in range(100):
        *moved, force = INTEGRATORS[name].step(drive, law, state, command, step_s)
        state = tuple(moved)
        later = total_energy_j(drive, law, state, command)
        assert later <= energy + 1e-12 * start
        assert force >= 0.0
        energy = later


@pytest.mark.parametrize(
    "step", [step_explicit, step_semi_implicit, INTEGRATORS["exact with events"].step]
)
def test_nothing_touches_above_the_surface(step):
    state = step(FREE, ContactLaw(5000.0, 20.0), (0.001, -0.5), 0.0, 1e-3)
    assert state == pytest.approx((0.0005, -0.5, 0.0))


@pytest.mark.parametrize(
    ("step", "limit"),
    [(step_explicit, explicit_limit_s), (step_semi_implicit, semi_implicit_limit_s)],
)
@settings(max_examples=60, deadline=None)
@given(STIFFNESS, MASS, st.sampled_from([0.05, 0.3, 0.9, 1.0, 1.5]), SPRING)
def test_sustained_contact_breaks_at_its_limit(step, limit, stiffness, mass, ratio, spring):
    drive, law = Drive(mass, spring, 0.0), wall(mass, stiffness, ratio)
    depth = -1.0  # far inside: a linear map
    edge_s = limit(drive, law)

    def radius(step_s):
        origin = np.array(step(drive, law, (depth, 0.0), 0.0, step_s)[:2])
        along = np.array(step(drive, law, (depth - 1.0, 0.0), 0.0, step_s)[:2]) - origin
        speed = np.array(step(drive, law, (depth, -1e-4), 0.0, step_s)[:2]) - origin
        return np.abs(np.linalg.eigvals(np.column_stack([-along, -speed / 1e-4]))).max()

    assert radius(edge_s) == pytest.approx(1.0, abs=1e-3)  # a double root at critical damping
    assert radius(0.9 * edge_s) < 1.0 - 1e-6
    assert radius(1.1 * edge_s) > 1.0 + 1e-6


def test_without_damping_explicit_euler_has_no_stable_step():
    assert explicit_limit_s(FREE, ContactLaw(1e4)) == 0.0
    assert semi_implicit_limit_s(FREE, ContactLaw(1e4)) == pytest.approx(
        2.0 * math.sqrt(0.08 / 1e4)
    )


def test_a_law_that_is_not_linear_is_refused():
    with pytest.raises(InputError, match="dissipation_s_m"):
        step_exact(FREE, ContactLaw(1e4, 0.0, 0.3), (0.0, -0.1), 0.0, 1e-3)
