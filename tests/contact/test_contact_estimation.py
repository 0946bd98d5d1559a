"""Contacts of known parameters, and data that teach nothing."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.contact.estimation import ContactEstimator, ContactModel, EstimationSettings
from mmt.core.errors import InputError

TICK_S = 1e-3


def strokes(seconds, deepest_m, surface_m=0.0):
    """In and out of the surface at 2 Hz, a third of the time free, with a little 5 Hz."""
    time_s = np.arange(0.0, seconds, TICK_S)
    swing = 0.75 * np.sin(2 * np.pi * 2 * time_s - 1.5) + 0.25 * np.sin(2 * np.pi * 5 * time_s)
    return surface_m + deepest_m * (0.3 + 0.7 * swing)


def learn(model, depth_m, noise_n=0.0, settings=None, lost=range(0)):
    rng = np.random.default_rng(0)
    estimator = ContactEstimator(settings)
    speed = np.gradient(depth_m, settings.tick_s if settings else TICK_S)
    for tick, (depth, rate) in enumerate(zip(depth_m.tolist(), speed.tolist(), strict=True)):
        if tick not in lost:
            ticks = 1 + len(lost) * (tick == lost.stop)
            estimator.update(depth, model.force_n(depth, rate) + noise_n * rng.normal(), ticks)
    return estimator


@pytest.mark.parametrize("stiffness", [1e2, 1e3, 1e4, 1e5])
@pytest.mark.parametrize("surface", [0.0, -0.3])
def test_kelvin_voigt_is_found_from_foam_to_rigid(stiffness, surface):
    truth = ContactModel(surface, stiffness, damping_n_s_m=0.005 * stiffness)
    found = learn(truth, strokes(3.0, 5.0 / stiffness, surface)).kelvin_voigt()
    assert found.stiffness_n_m == pytest.approx(stiffness, rel=0.1)
    assert found.surface_m == pytest.approx(surface, abs=0.5 / stiffness)
    near = 0.03 if stiffness < 1e5 else 0.25  # moved by 0.05 mm, damping hardly shows
    assert found.damping_n_s_m == pytest.approx(truth.damping_n_s_m, rel=near)


@pytest.mark.parametrize("lost", [range(2020, 2080), range(2100, 2200), range(2050, 2505)])
@pytest.mark.parametrize(
    "truth", [ContactModel(0.0, 1000.0, 1.0, 5.0), ContactModel(0.0, 6e4, 1.5)]
)
def test_lost_samples_change_no_model_whether_the_tool_stays_or_touches_meanwhile(truth, lost):
    found = learn(truth, strokes(lost.stop * TICK_S + 0.3, 5e-3), 0.01, lost=lost).best()
    for place in ((1e-3, 0.0), (3e-3, 0.2), (3e-3, -0.2)):
        assert found.force_n(*place) == pytest.approx(truth.force_n(*place), rel=0.08)


def test_a_surface_that_changes_is_followed():
    estimator = learn(ContactModel(0.0, 5000.0), strokes(3.0, 1e-3))
    soft = ContactModel(0.0, 500.0)
    for depth in strokes(6.0, 5e-3).tolist():
        estimator.update(depth, soft.force_n(depth, 0.0))
    found = estimator.kelvin_voigt()
    assert found.stiffness_n_m == pytest.approx(500.0, rel=0.1)


def test_a_surface_that_is_gone_is_unlearned_when_nothing_is_met_there():
    wall = ContactModel(0.0, 2000.0)
    estimator = learn(wall, strokes(2.0, 2e-3))
    for depth in strokes(10.0, 2e-3).tolist():
        estimator.update(depth, 0.0)
    for left in (estimator.kelvin_voigt(), estimator.best()):
        assert left is None or left.force_n(2e-3, 0.0) < 0.3 * wall.force_n(2e-3, 0.0)


def test_a_push_on_the_way_out_teaches_nothing():
    """Something else pushes at another place, harder and longer than a touch of the wall."""
    wall = ContactModel(0.0, 10_000.0, damping_n_s_m=20.0)
    depth_m = strokes(4.0, 5e-4)
    speed_m_s = np.gradient(depth_m, TICK_S)
    estimator = ContactEstimator()
    for depth, rate in zip(depth_m.tolist(), speed_m_s.tolist(), strict=True):
        stray_n = 3.0 if depth < -5e-5 and rate < -2e-3 else 0.0
        estimator.update(depth, wall.force_n(depth, rate) + stray_n)
    found = estimator.kelvin_voigt()
    assert found.stiffness_n_m == pytest.approx(10_000.0, rel=0.15)


@pytest.mark.parametrize("drag_n", [0.1, 0.5])
def test_drag_is_not_taken_for_contact(drag_n):
    """Knocks of 5 N on a wall, with a drag that pulls on the way in and pushes deep in the air."""
    wall = ContactModel(0.0, 10_000.0, damping_n_s_m=20.0)
    estimator = ContactEstimator()
    for tick in range(5000):
        phase = 2 * math.pi * 2e-3 * tick
        depth, rate = 5e-3 * math.sin(phase) - 4.5e-3, 5e-3 * 4 * math.pi * math.cos(phase)
        drag = drag_n * math.sin(phase + 4.0)
        estimator.update(depth, wall.force_n(depth, rate) + drag)
    assert estimator.contacts == 10
    found = estimator.kelvin_voigt()
    assert found.stiffness_n_m == pytest.approx(10_000.0, rel=0.5)


def test_without_contact_there_is_no_model():
    estimator = ContactEstimator()
    for depth in strokes(5.0, 0.01).tolist():
        estimator.update(depth, 0.02 * math.sin(1e4 * depth))
    assert estimator.best() is None
    assert estimator.contacts == estimator.samples == 0


def test_what_is_not_finite_is_left_out():
    wall = ContactModel(0.0, 1000.0)
    estimator, clean = ContactEstimator(), ContactEstimator()
    for tick, depth in enumerate(strokes(2.0, 2e-3).tolist()):
        clean.update(depth, wall.force_n(depth, 0.0))
        estimator.update(depth, wall.force_n(depth, 0.0))
        if tick % 7 == 0:
            estimator.update(math.nan, 1.0)
            estimator.update(depth, math.inf)
    assert estimator.best() == clean.best()


FINE = EstimationSettings(tick_s=1e-4)


@pytest.mark.parametrize("origin_m", [0.0, -0.25])
@pytest.mark.parametrize(
    ("stiffness", "damping", "found_stiffness", "found_damping"),
    [(2e3, 20.0, 2e3, 20.0), (2e3, -20.0, 2e3, 0.0), (3e6, 3e4, 1e6, 1e4)],
)
def test_a_session_may_begin_in_contact_anywhere(
    stiffness, damping, found_stiffness, found_damping, origin_m
):
    surface_m = origin_m - 1.25e-4
    time_s = np.arange(0.0, 1.0, FINE.tick_s)
    depth_m = origin_m + 1.5e-3 * (1.0 - np.cos(6 * np.pi * time_s))
    truth = ContactModel(surface_m, stiffness, damping_n_s_m=damping)
    estimator = learn(truth, depth_m, settings=FINE)
    spring, power = estimator.kelvin_voigt(), estimator.hunt_crossley()
    assert estimator.contacts == 1
    assert spring.surface_m == pytest.approx(surface_m, abs=2e-6)
    assert spring.stiffness_n_m == pytest.approx(found_stiffness, rel=2e-3)
    assert spring.damping_n_s_m == pytest.approx(found_damping, rel=0.03)
    assert power.surface_m == pytest.approx(origin_m)


@pytest.mark.parametrize(
    ("exponent", "dissipation", "found"), [(1.5, 2.0, 2.0), (2.0, -2.0, 0.0), (0.8, 14.0, 10.0)]
)
def test_a_power_law_is_found_exactly_where_touch_is_seen_at_once(exponent, dissipation, found):
    settings = EstimationSettings(contact_n=1e-3, tick_s=2e-4)
    truth = ContactModel(0.0, 5.0 / 0.003**exponent, exponent, dissipation_s_m=dissipation)
    time_s = np.arange(0.0, 2.0, settings.tick_s)
    depth_m = 3e-3 * np.sin(np.pi * time_s - 1.5)
    model = learn(truth, depth_m, settings=settings).hunt_crossley()
    assert model.exponent == pytest.approx(exponent, rel=0.03)
    assert model.spring_n(2e-3) == pytest.approx(truth.spring_n(2e-3), rel=0.03)
    assert model.dissipation_s_m == pytest.approx(found, rel=0.1)


@pytest.mark.parametrize("exponent", [0.4, 4.0])
def test_a_law_that_no_surface_has_is_not_found(exponent):
    settings = EstimationSettings(contact_n=1e-3)
    truth = ContactModel(0.0, 5.0 / 0.003**exponent, exponent)
    assert ContactEstimator(settings).hunt_crossley() is None
    assert learn(truth, strokes(4.0, 3e-3), settings=settings).hunt_crossley() is None


@pytest.mark.parametrize(("stiffness", "known"), [(0.0, False), (5.0, False), (30.0, True)])
def test_a_stiffness_counts_once_it_is_above_its_own_doubt(stiffness, known):
    """0.05 N of noise over half a second of 1 mm to and fro: a standard error of some 2 N/m."""
    estimator = ContactEstimator()
    for tick in range(4000):
        depth = 1e-3 * math.sin(6 * math.pi * 1e-3 * tick)
        estimator.update(depth, 1.0 + stiffness * depth)
    model = estimator.kelvin_voigt()
    assert (model is not None) is known
    if model is not None:
        assert model.stiffness_n_m == pytest.approx(stiffness, rel=0.01)


@pytest.mark.parametrize(
    ("deepest_m", "rate_hz", "ticks", "known"), [(5e-5, 20, 100, False), (1e-4, 5, 3000, True)]
)
def test_an_exponent_counts_once_it_is_above_its_own_doubt(deepest_m, rate_hz, ticks, known):
    """Up to 0.1 N, beside 0.05 N of noise, on 1 N/mm: what is taken for likely at the start."""
    estimator = ContactEstimator(EstimationSettings(contact_n=1e-4))
    for tick in range(ticks):
        depth_m = deepest_m * math.sin(math.pi * rate_hz * 1e-3 * tick) ** 2
        estimator.update(depth_m, 1000.0 * depth_m)
    model = estimator.hunt_crossley()
    assert (model is not None) is known
    if model is not None:
        assert model.exponent == pytest.approx(1.0, rel=0.03)
        deepest_n = model.spring_n(model.surface_m + deepest_m)
        assert deepest_n == pytest.approx(1000.0 * deepest_m, rel=0.03)
        assert model.dissipation_s_m == pytest.approx(0.0, abs=0.1)


def test_touch_is_where_the_force_was_last_small():
    """0.2 N, 2 mm deep, at first; a quarter of it once that is known to be no bias."""
    truth = ContactModel(0.0, 100.0)
    there = np.arange(-2e-3, 20e-3, 4e-5)
    once = np.concatenate([there, there[::-1]])
    for strokes_made, touch_m in ((1, 2e-3), (2, 0.5e-3)):
        model = learn(truth, np.tile(once, strokes_made)).hunt_crossley()
        assert model.surface_m == pytest.approx(touch_m, abs=1.5e-4)


@pytest.mark.parametrize("exponent", [1.0, 1.8])
def test_stiffness_counts_as_far_as_it_explains_the_force(exponent):
    """Strokes of 2 Hz, and a hum of 20 Hz that depends on no depth."""
    damping = 2.0 if exponent == 1.0 else 0.0
    truth = ContactModel(0.0, 0.5 / 0.002**exponent, exponent, damping)
    time_s = np.arange(0.0, 6.0, TICK_S)
    depth_m = 2e-3 - 2.2e-3 * np.exp(-time_s / 0.05) + 1e-3 * np.sin(4 * np.pi * time_s)
    spring_n = np.vectorize(truth.force_n)(depth_m, np.gradient(depth_m, TICK_S))
    hum_n = np.where(time_s < 0.5, 0.0, 0.1 * np.sin(40 * np.pi * time_s))
    estimator = ContactEstimator(EstimationSettings(contact_n=0.0025))
    for depth, force in zip(depth_m.tolist(), (spring_n + hum_n).tolist(), strict=True):
        estimator.update(depth, force)
    models = (estimator.kelvin_voigt(), estimator.hunt_crossley())
    chosen, best = models[exponent > 1.0], estimator.best()
    felt_n = spring_n + hum_n / math.hypot(1.0, 40 * math.pi * 3e-3)
    square = np.average([spring_n**2, felt_n**2], axis=1, weights=np.exp(time_s))
    assert best.exponent == chosen.exponent
    explained = best.stiffness_n_m / chosen.stiffness_n_m
    assert explained == pytest.approx(square[0] / square[1], abs=0.005)
    assert best.damping_n_s_m == pytest.approx(explained * chosen.damping_n_s_m)
    assert (best.damping_n_s_m > 0.0) is (exponent == 1.0)


def test_what_moves_teaches_and_what_rests_only_if_the_model_is_wrong():
    wall = ContactModel(0.0, 2000.0)
    estimator, depth_m = learn(wall, np.tile(strokes(1.0, 2e-3), 2)), 1e-3
    for speed_mm_s, more_n, least, most in (
        (0.0, 0.0, 0, 30),
        (0.0, 0.06, 0, 9),
        (0.5, 0.0, 0, 9),
        (2.0, 0.0, 90, 100),
        (-2.0, 0.0, 90, 100),
        (0.0, 0.5, 5, 100),
    ):
        before = estimator.samples
        for _ in range(100):
            depth_m += speed_mm_s * 1e-6
            estimator.update(depth_m, wall.force_n(depth_m, 0.0) + more_n)
        assert least <= estimator.samples - before <= most


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-100.0, 100.0)), min_size=1, max_size=200)
)
def test_any_data_give_a_finite_model_that_never_pulls(data):
    estimator = ContactEstimator()
    for depth, force in data:
        estimator.update(depth, force)
        model = estimator.best()
        if model is None:
            continue
        assert model.stiffness_n_m > 0.0
        assert model.damping_n_s_m >= 0.0
        assert model.dissipation_s_m >= 0.0
        force_n = model.force_n(depth, -1.0)
        assert math.isfinite(force_n)
        assert force_n >= 0.0


@given(
    st.floats(-5e-3, 5e-3),
    st.floats(-1.0, 1.0),
    st.sampled_from([0.5, 1.0, 1.5, 3.0]),
    st.floats(0.0, 100.0),
    st.floats(0.0, 2.0),
    st.floats(0.0, 50.0),
)
def test_a_model_pushes_as_its_law_says(depth, speed, exponent, damping, dissipation, most):
    model = ContactModel(-1e-3, 2e3, exponent, damping, dissipation)
    place = depth - -1e-3
    spring = 2e3 * max(place, 0.0) ** exponent
    damped = spring + min(damping + dissipation * spring, most) * speed
    assert model.spring_n(depth) == pytest.approx(spring)
    assert model.force_n(depth, speed, most) == pytest.approx(max(damped, 0.0) if spring else 0.0)
    assert model.stiffness_at(0.0) == model.stiffness_at(-1.0) == 2e3


def test_the_slope_of_a_power_law_is_the_derivative_of_its_force():
    model = ContactModel(0.0, 4e4, 1.5)
    depth = 2e-3
    slope = (model.spring_n(depth + 1e-7) - model.spring_n(depth - 1e-7)) / 2e-7
    assert model.stiffness_at(model.spring_n(depth)) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("name", ["contact_n", "forgetting_s", "tick_s"])
def test_settings_out_of_range_are_named(name):
    with pytest.raises(InputError, match=name):
        EstimationSettings(**{name: 0.0})
