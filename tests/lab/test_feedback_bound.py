"""The closest forces that a passive display can show."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from mmt.contact.passivity import ForcePort, PassivitySettings
from mmt_lab.feedback.passive_bound import closest_passive, least_shown

Series = list[tuple[float, float]]

STEPS = st.lists(
    st.tuples(st.floats(-10.0, 10.0), st.integers(-100, 100).map(lambda n: 1e-5 * n)),
    min_size=2,
    max_size=40,
)


def net_j(force_n: np.ndarray, travel_m: np.ndarray) -> np.ndarray:
    return np.cumsum(force_n * travel_m)


def squares(error_n: np.ndarray) -> float:
    return float(error_n @ error_n)


@pytest.mark.parametrize("seed", range(5))
def test_a_general_solver_finds_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    force_n, travel_m = rng.normal(0.0, 2.0, 12), rng.normal(0.0, 1.0, 12)
    below = np.tril(np.ones((12, 12))) * travel_m
    solved = minimize(
        lambda shown: squares(shown - force_n),
        np.zeros(12),
        jac=lambda shown: 2.0 * (shown - force_n),
        constraints={"type": "ineq", "fun": lambda shown: below @ shown + 0.5},
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert solved.success
    assert closest_passive(force_n, travel_m, 0.5) == pytest.approx(solved.x, abs=1e-4)


@given(STEPS, st.floats(0.0, 1e-2))
@settings(max_examples=100, deadline=None)
def test_the_hand_gets_no_more_than_it_gave_and_the_energy_at_the_beginning(
    steps: Series, energy_j: float
) -> None:
    force_n, travel_m = np.array(steps).T
    shown = closest_passive(force_n, travel_m, energy_j)
    assert np.all(net_j(shown, travel_m) >= -energy_j - 1e-9)


@given(STEPS)
@settings(max_examples=100, deadline=None)
def test_no_port_comes_closer(steps: Series) -> None:
    force_n, travel_m = np.array(steps).T
    port = ForcePort(PassivitySettings(reserve_j=1e-3))
    depth_m = np.concatenate(([0.0], np.cumsum(travel_m)))[:-1]
    shown = [port.step(f, -d) for f, d in zip(force_n.tolist(), depth_m.tolist(), strict=True)]
    overdrawn_j = max(0.0, -float(net_j(np.array(shown), travel_m).min()) - 1e-3)
    best = closest_passive(force_n, travel_m, 1e-3 + overdrawn_j)
    assert squares(best - force_n) <= squares(np.array(shown) - force_n) + 1e-9


def test_what_a_surface_pushes_back_with_is_shown_whole() -> None:
    depth_m = 2e-3 * np.sin(np.arange(1000) / 50)
    force_n = 1000.0 * np.maximum(0.0, depth_m)
    travel_m = np.append(np.diff(depth_m), 0.0)
    assert closest_passive(force_n, travel_m, 1e-3) == pytest.approx(force_n)


def test_a_hand_at_rest_can_be_shown_anything() -> None:
    assert closest_passive(np.full(5, 3.0), np.zeros(5), 0.0) == pytest.approx(3.0)


def test_nothing_is_shown_before_the_first_contact_is_known() -> None:
    force_n, travel_m = np.ones(10), np.full(10, 1e-3)
    assert least_shown(force_n, travel_m, 0.0, 4).tolist() == [0.0] * 4 + [1.0] * 6
