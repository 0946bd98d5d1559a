"""Contacts of known parameters, and data that teach nothing."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.contact.estimation import ContactEstimator, ContactModel, EstimationSettings
from mmt.core.errors import InputError

TICK_S = 1e-3


def strokes(seconds: float, deepest_m: float, surface_m: float = 0.0) -> np.ndarray:
    """In and out of the surface at 2 Hz, a third of the time free, with a little 5 Hz."""
    time_s = np.arange(0.0, seconds, TICK_S)
    swing = 0.75 * np.sin(2 * np.pi * 2 * time_s - 1.5) + 0.25 * np.sin(2 * np.pi * 5 * time_s)
    return surface_m + deepest_m * (0.3 + 0.7 * swing)


def learn(
    model: ContactModel,
    depth_m: np.ndarray,
    noise_n: float = 0.0,
    settings: EstimationSettings | None = None,
) -> ContactEstimator:
    rng = np.random.default_rng(0)
    estimator = ContactEstimator(settings)
    speed = np.gradient(depth_m, settings.tick_s if settings else TICK_S)
    for depth, rate in zip(depth_m.tolist(), speed.tolist(), strict=True):
        estimator.update(depth, model.force_n(depth, rate) + noise_n * rng.normal())
    return estimator


@pytest.mark.parametrize("stiffness", [1e2, 1e3, 1e4, 1e5])
@pytest.mark.parametrize("surface", [0.0, -0.3])
def test_kelvin_voigt_is_found_from_foam_to_rigid(stiffness: float, surface: float) -> None:
    truth = ContactModel(surface, stiffness, damping_n_s_m=0.005 * stiffness)
    found = learn(truth, strokes(3.0, 5.0 / stiffness, surface)).kelvin_voigt()
    assert found is not None
    assert found.stiffness_n_m == pytest.approx(stiffness, rel=0.1)
    assert found.surface_m == pytest.approx(surface, abs=0.5 / stiffness)
    assert found.damping_n_s_m == pytest.approx(truth.damping_n_s_m, rel=0.3)


def test_noise_of_a_sensor_does_not_hide_a_spring() -> None:
    truth = ContactModel(0.0, 1500.0, damping_n_s_m=5.0)
    found = learn(truth, strokes(4.0, 3e-3), noise_n=0.05).best()
    assert found is not None
    assert found.stiffness_n_m == pytest.approx(1500.0, rel=0.05)


@pytest.mark.parametrize("exponent", [1.3, 1.8])
def test_hunt_crossley_is_found_and_chosen_where_the_spring_is_not_linear(exponent: float) -> None:
    truth = ContactModel(0.0, 5.0 / 0.003**exponent, exponent, dissipation_s_m=0.3)
    estimator = learn(truth, strokes(4.0, 3e-3))
    found, best = estimator.hunt_crossley(), estimator.best()
    assert found is not None
    assert best is not None
    assert found.exponent == pytest.approx(exponent, rel=0.15)
    assert best.exponent == found.exponent
    for depth in (1e-3, 2e-3, 3e-3):
        assert best.spring_n(depth) == pytest.approx(truth.spring_n(depth), rel=0.15, abs=0.1)


def test_a_surface_that_changes_is_followed() -> None:
    estimator = learn(ContactModel(0.0, 5000.0), strokes(3.0, 1e-3))
    soft = ContactModel(0.0, 500.0)
    for depth in strokes(6.0, 5e-3).tolist():
        estimator.update(depth, soft.force_n(depth, 0.0))
    found = estimator.kelvin_voigt()
    assert found is not None
    assert found.stiffness_n_m == pytest.approx(500.0, rel=0.1)


def test_a_surface_that_is_gone_is_unlearned_when_nothing_is_met_there() -> None:
    wall = ContactModel(0.0, 2000.0)
    estimator = learn(wall, strokes(2.0, 2e-3))
    for depth in strokes(10.0, 2e-3).tolist():
        estimator.update(depth, 0.0)
    left = estimator.best()
    assert left is None or left.force_n(2e-3, 0.0) < 0.3 * wall.force_n(2e-3, 0.0)


def test_a_push_on_the_way_out_teaches_nothing() -> None:
    """Something else pushes at another place, harder and longer than a touch of the wall."""
    wall = ContactModel(0.0, 10_000.0, damping_n_s_m=20.0)
    depth_m = strokes(4.0, 5e-4)
    speed_m_s = np.gradient(depth_m, TICK_S)
    estimator = ContactEstimator()
    for depth, rate in zip(depth_m.tolist(), speed_m_s.tolist(), strict=True):
        stray_n = 3.0 if depth < -5e-5 and rate < -2e-3 else 0.0
        estimator.update(depth, wall.force_n(depth, rate) + stray_n)
    found = estimator.kelvin_voigt()
    assert found is not None
    assert found.stiffness_n_m == pytest.approx(10_000.0, rel=0.15)


def test_a_push_on_the_way_out_is_contact_once_the_tool_comes_back_into_it() -> None:
    estimator = ContactEstimator()
    for depth in np.linspace(0.0, -2e-3, 200).tolist():
        estimator.update(depth, 2.0 if depth < -1e-3 else 0.0)
    assert not estimator.contact
    for depth in np.linspace(-2e-3, 0.0, 200).tolist():
        estimator.update(depth, 2.0)
    assert estimator.contact
    assert estimator.contacts == 1


@pytest.mark.parametrize("drag_n", [0.1, 0.5])
def test_drag_is_not_taken_for_contact(drag_n: float) -> None:
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
    assert found is not None
    assert found.stiffness_n_m == pytest.approx(10_000.0, rel=0.5)


def test_without_contact_there_is_no_model() -> None:
    estimator = ContactEstimator()
    for depth in strokes(5.0, 0.01).tolist():
        estimator.update(depth, 0.02 * math.sin(1e4 * depth))
    assert estimator.best() is None
    assert estimator.contacts == estimator.samples == 0


def test_rest_in_contact_teaches_nothing_and_forgets_nothing() -> None:
    wall = ContactModel(0.0, 2000.0, damping_n_s_m=4.0)
    estimator = learn(wall, strokes(3.0, 2e-3))
    before = estimator.kelvin_voigt()
    depth = 1e-3
    for _ in range(20_000):
        estimator.update(depth, wall.force_n(depth, 0.0))
    after = estimator.kelvin_voigt()
    assert before is not None
    assert after is not None
    assert after.stiffness_n_m == pytest.approx(before.stiffness_n_m, rel=0.02)


def test_what_is_not_finite_is_left_out() -> None:
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
    stiffness: float, damping: float, found_stiffness: float, found_damping: float, origin_m: float
) -> None:
    surface_m = origin_m - 1.25e-4
    time_s = np.arange(0.0, 1.0, FINE.tick_s)
    depth_m = origin_m + 1.5e-3 * (1.0 - np.cos(6 * np.pi * time_s))
    truth = ContactModel(surface_m, stiffness, damping_n_s_m=damping)
    estimator = learn(truth, depth_m, settings=FINE)
    spring, power = estimator.kelvin_voigt(), estimator.hunt_crossley()
    assert spring is not None
    assert power is not None
    assert estimator.contacts == 1
    assert spring.surface_m == pytest.approx(surface_m, abs=2e-6)
    assert spring.stiffness_n_m == pytest.approx(found_stiffness, rel=2e-3)
    assert spring.damping_n_s_m == pytest.approx(found_damping, rel=0.03)
    assert power.surface_m == pytest.approx(origin_m)


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-100.0, 100.0)), min_size=1, max_size=200)
)
@settings(max_examples=60, deadline=None)
def test_any_data_give_a_finite_model_that_never_pulls(data: list[tuple[float, float]]) -> None:
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
def test_a_model_pushes_as_its_law_says(depth, speed, exponent, damping, dissipation, most) -> None:
    model = ContactModel(-1e-3, 2e3, exponent, damping, dissipation)
    place = depth - -1e-3
    spring = 2e3 * max(place, 0.0) ** exponent
    damped = spring + min(damping + dissipation * spring, most) * speed
    assert model.spring_n(depth) == pytest.approx(spring)
    assert model.force_n(depth, speed, most) == pytest.approx(max(damped, 0.0) if spring else 0.0)
    assert model.stiffness_at(0.0) == model.stiffness_at(-1.0) == 2e3


def test_the_slope_of_a_power_law_is_the_derivative_of_its_force() -> None:
    model = ContactModel(0.0, 4e4, 1.5)
    depth = 2e-3
    slope = (model.spring_n(depth + 1e-7) - model.spring_n(depth - 1e-7)) / 2e-7
    assert model.stiffness_at(model.spring_n(depth)) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("name", ["contact_n", "forgetting_s", "tick_s"])
def test_settings_out_of_range_are_named(name: str) -> None:
    with pytest.raises(InputError, match=name):
        EstimationSettings(**{name: 0.0})
