"""Observations of a field predicted from all others."""

import numpy as np
import pytest

from mmt.texture.field.covariance import Coordinates, coordinates, prior_covariance, settings
from mmt.texture.field.posterior import SETTINGS
from mmt_methods.selection.consensus import LeaveOneOut

FACTORS = (1.0, 9.0)


def observations(n, dimensions, seed=0, channels=3, scatter=0.04):
    """Return points, a field of the prior's median with scatter at them, and the scatter."""
    generator = np.random.default_rng(seed)
    points = generator.uniform(0.1, 1.0, (n, dimensions))
    if dimensions == 3:
        points[:, :2] *= generator.choice([-1.0, 1.0], (n, 2))
    at = coordinates(points)
    setting = np.median(settings(SETTINGS, directed=dimensions == 3, rough=False), axis=0)
    prior = prior_covariance(at, at, setting)
    scatters = scatter * generator.uniform(0.5, 2.0, n)
    root = np.linalg.cholesky(prior + np.diag(scatters))
    return points, root @ generator.normal(size=(n, channels)), scatters


def rebuilt(points, values, scatters, present, index, effective):
    """Predict one observation by the mixture over all settings, from the others alone."""
    directed = points.shape[1] == 3
    at = coordinates(points)
    means, variances, evidence = [], [], []
    known = np.flatnonzero(present)
    others = known[known != index]
    rest = values - values[known].mean(axis=0)
    own = Coordinates(*(axis[[index]] for axis in at))
    far = Coordinates(*(axis[others] for axis in at))
    for setting in settings(SETTINGS, directed=directed, rough=False):
        prior = prior_covariance(at, at, setting)
        across = prior_covariance(own, far, setting)[0]
        for factor in FACTORS:
            total = prior + factor * np.diag(scatters)
            every, left = total[np.ix_(known, known)], total[np.ix_(others, others)]
            squares = np.einsum("ic,ij,jc->", rest[known], np.linalg.inv(every), rest[known])
            each = 0.5 * squares / values.shape[1] + 0.5 * np.linalg.slogdet(every)[1]
            evidence.append(-effective * each)
            gains = np.linalg.solve(left, across)
            means.append(gains @ rest[others])
            variances.append(total[index, index] - gains @ across)
    weights = np.exp(np.array(evidence) - max(evidence))
    weights[weights < 0.1] = 0.0
    weights /= weights.sum()
    mean = weights @ np.array(means)
    apart = np.square(np.array(means) - mean).mean(axis=1)
    return mean + values[known].mean(axis=0), weights @ (np.array(variances) + apart)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_closed_form_is_what_rebuilding_without_each_gives(dimensions):
    points, values, scatters = observations(24, dimensions)
    present = np.ones(24, dtype=np.bool_)
    present[[3, 11]] = False
    found = LeaveOneOut(points, scatters, FACTORS).predict([values], [2.0], present)[0]
    for index in (0, 3, 7, 11, 23):
        mean, variance = rebuilt(points, values, scatters, present, index, 2.0)
        np.testing.assert_allclose(found.mean[index], mean, atol=1e-7)
        assert found.variance[index] == pytest.approx(variance, rel=1e-6)


def test_groups_have_mixtures_of_their_own():
    points, rough, scatters = observations(60, 2, scatter=0.4)
    _, smooth, _ = observations(60, 2, scatter=1e-4)
    others = LeaveOneOut(points, scatters, (0.001, 1.0))
    present = np.ones(60, dtype=np.bool_)
    both = others.predict([rough, smooth], [3.0, 3.0], present)
    assert both[0].scatter.mean() > 10.0 * both[1].scatter.mean()
    alone = others.predict([smooth], [3.0], present)[0]
    np.testing.assert_array_equal(both[1].mean, alone.mean)


def test_repeated_points_and_constant_values_do_no_harm():
    points = np.full((12, 2), 0.4)
    others = LeaveOneOut(points, np.full(12, 0.01), (1.0,))
    found = others.predict([np.full((12, 1), 5.0)], [1.0], np.ones(12, dtype=np.bool_))[0]
    np.testing.assert_allclose(found.mean, 5.0)
    assert np.isfinite(found.variance).all()
