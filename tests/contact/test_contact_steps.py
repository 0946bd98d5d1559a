"""Contact: energy, unilateral force, and agreement with closed forms."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.contact.steps import (
    SMOOTHING_M_S,
    STEP_ANGLE,
    ContactLaw,
    Drive,
    friction_slope_n_s_m,
    step_normal,
    step_tangential,
    substeps,
)
from mmt.core.errors import InputError

STIFFNESS = st.floats(50.0, 50_000.0)
MASS = st.floats(0.02, 0.5)
VELOCITY = st.floats(-2.0, 2.0)


def _energy(drive, law, height, velocity, command):
    return (
        0.5 * drive.mass_kg * velocity**2
        + 0.5 * drive.stiffness_n_m * (command - height) ** 2
        + 0.5 * law.stiffness_n_m * min(height, 0.0) ** 2
    )


@settings(max_examples=200)
@given(STIFFNESS, MASS, VELOCITY, st.floats(0.0, 3000.0), st.floats(1e-5, 5e-3))
def test_undamped_energy_is_kept_through_impacts(stiffness, mass, velocity, spring, step_s):
    drive, law = Drive(mass, spring, 0.0), ContactLaw(stiffness)
    command = -0.002
    height = 0.003
    start = _energy(drive, law, height, velocity, command)
    for _ in range(300):
        height, velocity, force = step_normal(drive, law, (height, velocity), command, step_s)
        assert force >= 0.0
    energy = _energy(drive, law, height, velocity, command)
    assert energy == pytest.approx(start, rel=1e-8, abs=1e-12)


@settings(max_examples=200)
@given(
    STIFFNESS,
    MASS,
    VELOCITY,
    st.floats(0.0, 500.0),
    st.floats(0.0, 20.0),
    st.floats(0.0, 50.0),
    st.floats(1e-5, 5e-3),
)
def test_energy_never_rises_by_itself(stiffness, mass, velocity, damp, dissip, ground, step_s):
    drive, law = Drive(mass, 700.0, ground), ContactLaw(stiffness, damp, dissip)
    command, height = -0.004, 0.002
    energy = _energy(drive, law, height, velocity, command)
    for _ in range(300):
        height, velocity, force = step_normal(drive, law, (height, velocity), command, step_s)
        later = _energy(drive, law, height, velocity, command)
        assert later <= energy * (1.0 + 1e-10) + 1e-15
        assert force >= 0.0
        energy = later


@pytest.mark.parametrize("stiffness_n_mm", [0.05, 0.5, 5.0, 50.0])
def test_settles_at_the_static_depth(stiffness_n_mm):
    law = ContactLaw(stiffness_n_mm * 1000.0, dissipation_s_m=1.0)
    drive = Drive(0.08, 2700.0, 30.0)
    step_s = 1e-3 / substeps(drive, law, 1e-3)
    height, velocity, force = 0.001, 0.0, 0.0
    for _ in range(int(2.0 / step_s)):
        height, velocity, force = step_normal(drive, law, (height, velocity), -0.003, step_s)
    series = 1.0 / (1.0 / law.stiffness_n_m + 1.0 / drive.stiffness_n_m)
    assert force == pytest.approx(series * 0.003, rel=1e-6)
    assert height == pytest.approx(-force / law.stiffness_n_m, rel=1e-6)


@pytest.mark.parametrize("stiffness_n_mm", [0.05, 5.0, 50.0])
def test_impact_lasts_half_a_period(stiffness_n_mm):
    """A free mass on a spring touches for pi sqrt(m/k) and leaves with its own speed."""
    law, drive = ContactLaw(stiffness_n_mm * 1000.0), Drive(0.08, 0.0, 0.0)
    step_s = 1e-3 / substeps(drive, law, 1e-3)
    height, velocity, touching = 0.0, -0.5, 0
    for _ in range(1000):
        if touching and height >= 0.0:
            break
        height, velocity, force = step_normal(drive, law, (height, velocity), 0.0, step_s)
        touching += force > 0.0
        peak = law.stiffness_n_m * max(-height, 0.0)
        assert peak <= 0.5 * math.sqrt(law.stiffness_n_m * 0.08) * (1 + 1e-9)
    assert velocity == pytest.approx(0.5, rel=1e-9)
    period = math.pi * math.sqrt(0.08 / law.stiffness_n_m)
    assert touching * step_s == pytest.approx(period, rel=0.02, abs=2 * step_s)


def test_hunt_crossley_restitution():
    """To first order e = 1 - (2/3) a v for a k d d' (Hunt and Crossley 1975, alpha = 1.5 e')."""
    law, drive = ContactLaw(5000.0, dissipation_s_m=0.3), Drive(0.08, 0.0, 0.0)
    height, velocity = 0.0, -0.2
    for _ in range(20_000):
        height, velocity, _ = step_normal(drive, law, (height, velocity), 0.0, 2e-6)
        if height > 0.0:
            break
    assert velocity / 0.2 == pytest.approx(1 - 2 / 3 * 0.3 * 0.2, abs=2e-3)


@given(
    STIFFNESS,
    st.floats(0.0, 100.0),
    st.floats(0.0, 10.0),
    st.floats(1e-4, 5e-3),
    st.floats(-2.0, 2.0),
)
def test_a_short_step_has_the_force_of_the_law(stiffness, damping, dissipation, depth, velocity):
    law = ContactLaw(stiffness, damping, dissipation)
    _, _, force = step_normal(Drive(0.08, 0.0, 0.0), law, (-depth, velocity), 0.0, 1e-9)
    expected = stiffness * depth - (damping + dissipation * stiffness * depth) * velocity
    assert force == pytest.approx(max(expected, 0.0), rel=1e-4, abs=1e-3)


def test_a_step_into_the_surface_is_damped_as_deep_as_it_goes():
    drive, law = Drive(0.08, 0.0, 0.0), ContactLaw(5000.0, dissipation_s_m=1.0)
    height, _, force = step_normal(drive, law, (0.0, -0.5), 0.0, 1e-4)
    depth = 0.5 * 0.5 * 1e-4  # halfway along the free path
    assert force == pytest.approx(-5000.0 * (0.5 * height + depth * height / 1e-4), rel=1e-9)


def test_nothing_touches_above_the_surface():
    law = ContactLaw(5000.0, 20.0, 0.5)
    state = step_normal(Drive(0.08, 0.0, 0.0), law, (0.001, -0.5), 0.0, 1e-3)
    assert state == pytest.approx((0.0005, -0.5, 0.0))


@given(STIFFNESS, MASS, st.floats(0.0, 3000.0), st.floats(1e-5, 1e-2))
def test_substeps_are_the_fewest_with_a_small_phase(stiffness, mass, spring, tick_s):
    number = substeps(Drive(mass, spring, 0.0), ContactLaw(stiffness), tick_s)
    phase = math.sqrt((stiffness + spring) / mass) * tick_s
    assert phase <= STEP_ANGLE * number * (1 + 1e-12)
    assert number == 1 or phase > STEP_ANGLE * (number - 1) * (1 - 1e-12)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_bad_parameters_are_refused(value):
    with pytest.raises(InputError, match="stiffness_n_m"):
        ContactLaw(value)
    with pytest.raises(InputError, match="mass_kg"):
        Drive(value, 1.0, 1.0)
    if value != 0.0:
        with pytest.raises(InputError, match="damping_n_s_m"):
            Drive(1.0, 1.0, value)
        with pytest.raises(InputError, match="dissipation_s_m"):
            ContactLaw(1.0, 0.0, value)


@given(st.floats(0.0, 1.0), st.floats(0.0, 20.0), VELOCITY, st.floats(1e-5, 5e-3))
def test_friction_takes_energy_out(coefficient, normal_n, velocity, step_s):
    drive, position = Drive(0.08, 700.0, 0.0), 0.01

    def energy():
        return 0.04 * velocity**2 + 350.0 * position**2

    before = energy()
    for _ in range(100):
        slope = friction_slope_n_s_m(coefficient, normal_n, abs(velocity), SMOOTHING_M_S)
        position, velocity, _ = step_tangential(drive, slope, (position, velocity), 0.0, step_s)
        assert energy() <= before * (1 + 1e-10) + 1e-15
        before = energy()


def test_friction_is_coulomb_in_steady_sliding():
    drive, position, velocity, command = Drive(0.08, 700.0, 15.0), 0.0, 0.0, 0.0
    for tick in range(3000):
        command = 0.1 * tick * 1e-3
        slope = friction_slope_n_s_m(0.3, 2.0, abs(velocity), SMOOTHING_M_S)
        position, velocity, force = step_tangential(
            drive, slope, (position, velocity), command, 1e-3
        )
    assert velocity == pytest.approx(0.1, rel=1e-6)
    assert force == pytest.approx(-0.6, rel=2e-3)
    middle = position - 0.5 * velocity * 1e-3
    assert 700.0 * (command - middle) == pytest.approx(0.6 + 1.5, rel=2e-3)
