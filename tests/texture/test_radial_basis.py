"""Radial basis function networks against scipy's, and against retraining."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator

from mmt.core.errors import InputError
from mmt.texture.interpolation.radial_basis.choice import CANDIDATES, choose_settings, tried
from mmt.texture.interpolation.radial_basis.functions import (
    FUNCTIONS,
    KernelName,
    evaluate_into,
    monomials,
)
from mmt.texture.interpolation.radial_basis.network import RadialBasisSettings
from mmt.texture.interpolation.radial_basis.online import RadialBasisSystem

KERNELS = get_args(KernelName)


def scattered(count: int, dimensions: int, outputs: int = 4, seed: int = 0):
    generator = np.random.default_rng(seed)
    points = generator.random((count, dimensions))
    return points, np.sin(3.0 * points @ generator.standard_normal((dimensions, outputs)))


def by_scipy(points, values, chosen: RadialBasisSettings, queries):
    return RBFInterpolator(
        points,
        values,
        kernel=chosen.kernel,
        degree=chosen.highest_degree if chosen.degree is None else chosen.degree,
        epsilon=chosen.epsilon,
        smoothing=chosen.smoothing,
    )(queries)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("smoothing", [0.0, 1e-3])
def test_a_network_is_scipys(kernel, dimensions, smoothing):
    points, values = scattered(60, dimensions)
    queries = np.random.default_rng(1).random((20, dimensions))
    least = FUNCTIONS[kernel].least_degree
    for degree in {least, max(least, 0), max(least, 0) + 1}:
        chosen = RadialBasisSettings(kernel, degree, 4.0, smoothing)
        system = RadialBasisSystem(points, values, chosen)
        expected = by_scipy(points, values, chosen, queries)
        np.testing.assert_allclose(system.network().at(queries), expected, rtol=0, atol=1e-7)
        assert system.degree == degree


def test_every_kernel_of_scipy_is_there():
    from scipy.interpolate import _rbfinterp

    assert set(KERNELS) == set(_rbfinterp._AVAILABLE)
    least = {name: function.least_degree for name, function in FUNCTIONS.items()}
    assert {name: degree for name, degree in least.items() if degree >= 0} == dict(
        _rbfinterp._NAME_TO_MIN_DEGREE
    )


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("smoothing", [0.0, 1e-2])
def test_leave_one_out_errors_are_those_of_retraining(kernel, smoothing):
    points, values = scattered(24, 2)
    degree = max(FUNCTIONS[kernel].least_degree, 1)
    chosen = RadialBasisSettings(kernel, degree, 4.0, smoothing)
    errors = RadialBasisSystem(points, values, chosen).leave_one_out()
    for left in range(len(points)):
        others = np.arange(len(points)) != left
        guess = by_scipy(points[others], values[others], chosen, points[left : left + 1])
        np.testing.assert_allclose(errors[left], values[left] - guess[0], rtol=1e-6, atol=1e-8)


def test_a_sample_that_alone_tells_a_direction_cannot_be_left_out():
    line = np.column_stack([np.linspace(0.1, 0.9, 9), np.full(9, 0.5)])
    points = np.vstack([line, [[0.5, 0.9]]])
    errors = RadialBasisSystem(points, points.sum(axis=1, keepdims=True)).leave_one_out()
    assert np.isnan(errors[9]).all()
    assert np.isfinite(errors[:9]).all()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_choice_has_the_least_error_of_retraining(dimensions):
    points, values = scattered(30, dimensions, outputs=2)
    points[7] = points[3]  # a centre of two samples
    values += 0.1 * np.random.default_rng(2).standard_normal(values.shape)
    best = choose_settings(points, values, scale=np.ones(2), candidates=CANDIDATES[:9])
    trials = list(tried(points, values, np.ones(2), CANDIDATES[:9]))
    assert best.error == min(trial.error for trial in trials)
    for trial in [best, *trials[:: len(trials) // 6]]:
        assert trial.error == pytest.approx(_retrained(points, values, trial.settings), rel=1e-6)
    assert best.settings.smoothing > 0.0
    assert best.error < choose_settings(points, values, np.ones(2), CANDIDATES[6:7]).error


def _retrained(points, values, chosen) -> float:
    """Return the root mean square error over centres, each left out and trained anew."""
    system = RadialBasisSystem(points, values, chosen)
    errors = []
    for handles in system.handles:
        others = np.setdiff1d(np.arange(len(points)), handles)
        without = RadialBasisSystem(points[others], values[others], chosen).network()
        errors.append(values[handles].mean(axis=0) - without.at(points[handles[:1]])[0])
    return float(np.sqrt(np.mean(np.square(errors))))


def test_too_few_samples_choose_nothing():
    points, values = scattered(3, 3)
    chosen = choose_settings(points, values)
    assert chosen.settings == RadialBasisSettings()
    assert np.isnan(chosen.error)


def test_only_evenly_spread_samples_decide_for_a_large_model():
    points, values = scattered(900, 2, outputs=1)
    chosen = choose_settings(points, values, candidates=CANDIDATES[2:3])
    assert 0.0 < chosen.error < 0.05


def test_a_constant_output_does_not_disturb_the_choice():
    points, values = scattered(40, 2)
    with_constant = np.hstack([values, np.full((40, 1), 0.7)])
    assert choose_settings(points, with_constant, candidates=CANDIDATES[:4]).settings.kernel in (
        "linear",
        "thin_plate_spline",
    )


@given(
    count=st.integers(1, 12),
    dimensions=st.integers(2, 3),
    kernel=st.sampled_from(KERNELS),
    flatness=st.sampled_from(["scattered", "on a plane", "on a line", "one place"]),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=60, deadline=None)
def test_few_or_flat_samples_are_met(count, dimensions, kernel, flatness, seed):
    points, _ = scattered(count, dimensions, seed=seed)
    if flatness != "scattered":
        points[:, -1] = 0.25
    if flatness == "on a line":
        points[:, 1] = 0.5 * points[:, 0]
    if flatness == "one place":
        points[:] = points[0]
    values = np.sin(points @ np.random.default_rng(seed).standard_normal((dimensions, 4)))
    system = RadialBasisSystem(points, values, RadialBasisSettings(kernel, 2))
    at_centres = np.array([values[handles].mean(axis=0) for handles in system.handles])
    assert system.network().at(system.centres) == pytest.approx(at_centres, abs=2e-3)
    assert np.isfinite(system.network().at(np.random.default_rng(0).random((9, dimensions)))).all()


def test_the_degree_follows_the_number_of_samples():
    points, values = scattered(12, 3)
    degrees = [
        RadialBasisSystem(points[:n], values[:n], RadialBasisSettings("linear", 2)).degree
        for n in (1, 3, 4, 9, 10)
    ]
    assert degrees == [0, 0, 1, 1, 2]
    cubic = RadialBasisSettings("cubic", 2)
    assert RadialBasisSystem(points[:2], values[:2], cubic).degree == 1  # its least


def test_flat_functions_are_smoothed_as_far_as_their_solution_needs():
    points, values = scattered(80, 2)
    flat = RadialBasisSystem(points, values, RadialBasisSettings("gaussian", 0, 1.0))
    assert np.abs(flat.network().at(points) - values).max() < 0.05
    assert np.isfinite(flat.leave_one_out()).all()


def test_values_keep_their_digits_where_weights_cancel():
    points, values = scattered(400, 2, outputs=2)
    network = RadialBasisSystem(points, values, RadialBasisSettings("quintic", 2)).network()
    query = np.array([0.31, 0.77])
    radii = np.sqrt(((points - query).astype(np.longdouble) ** 2).sum(axis=1))
    powers = np.prod(query.astype(np.longdouble) ** network.exponents, axis=1)
    exact = -(radii**5) @ network.weights.astype(np.longdouble) + powers @ network.coefficients
    largest = np.abs((radii**5)[:, None] * network.weights).max()
    assert largest > 1e2
    error = np.abs(network.at(query[None])[0] - exact).max()
    assert error < 45 * np.finfo(float).eps * largest


def test_a_point_is_evaluated_in_place():
    points, values = scattered(50, 3)
    network = RadialBasisSystem(points, values, RadialBasisSettings("cubic", 1)).network()
    work, out = np.empty(4), np.empty(4)
    evaluate_into(
        network.number,
        1.0,
        network.centres,
        network.weights,
        network.exponents,
        network.coefficients,
        points[17],
        work,
        out,
    )
    np.testing.assert_allclose(out, values[17], atol=1e-10)


def test_monomials_are_counted_by_degree():
    assert monomials(3, 2).tolist() == [
        [0, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
        [2, 0, 0],
        [1, 1, 0],
        [1, 0, 1],
        [0, 2, 0],
        [0, 1, 1],
        [0, 0, 2],
    ]
    assert monomials(2, -1).shape == (0, 2)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kernel": "sinc"}, "allowed are linear, thin_plate_spline"),
        ({"kernel": "quintic", "degree": 1}, "with quintic, 2 to 4"),
        ({"epsilon": float("nan")}, "epsilon is nan"),
        ({"smoothing": -1.0}, "smoothing is -1"),
        ({"degree": 9}, "1 to 4"),
    ],
)
def test_settings_that_cannot_be_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        replace(RadialBasisSettings(), **changes)


@pytest.mark.parametrize(
    ("point", "values", "words"),
    [
        ([0.5, 9.0], [1.0], "normalised coordinates"),
        ([0.5, float("nan")], [1.0], "normalised coordinates"),
        ([0.5, 0.5], [float("inf")], "finite"),
        ([0.5, 0.5, 0.5], [1.0], "coordinates"),
        ([0.5, 0.5], [1.0, 2.0], "coordinates"),
    ],
)
def test_samples_that_cannot_be_are_refused(point, values, words):
    system = RadialBasisSystem(np.array([[0.1, 0.2]]), np.array([[1.0]]))
    with pytest.raises(InputError, match=words):
        system.add(np.array(point), np.array(values))
    assert len(system.centres) == 1


def test_a_network_needs_a_sample():
    with pytest.raises(InputError, match="at least one sample"):
        RadialBasisSystem(np.empty((0, 2)), np.empty((0, 1)))
    system = RadialBasisSystem(np.array([[0.1, 0.2]]), np.array([[1.0]]))
    with pytest.raises(InputError, match="only sample"):
        system.remove(0)
    with pytest.raises(InputError, match="sample 5"):
        system.remove(5)
