"""Frequencies of samples without their scatter: known answers, invariants, extremes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_samples import scattered, speed_of

from mmt.texture.autoregression.forms import effective_samples, reflection_to_lsf
from mmt.texture.field.shape_smoothing import LARGEST, smoothed, smoothed_shapes
from mmt.texture.interpolation.vertices import boundary
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import ANISOTROPIC, ISOTROPIC, TextureSamples


def truth(points):
    """Frequencies that drift slowly over the plane."""
    slow = 0.3 * speed_of(points) + 0.1 * points[:, -1]
    return np.column_stack([0.4 + slow, 0.9 + 0.5 * slow, np.full(len(points), 1.6), 2.2 + slow])


@pytest.mark.parametrize("directed", [False, True])
def test_most_of_the_scatter_is_taken_out_where_frequencies_drift_slowly(directed):
    points = scattered(60, directed)
    weights = np.random.default_rng(1).uniform(120.0, 600.0, 60)
    noise = np.random.default_rng(2).normal(size=(60, 4)) * 0.5 / np.sqrt(weights)[:, None]
    result = smoothed(points, truth(points) + noise, weights, points[:0])
    before = np.sqrt(np.mean(noise**2))
    after = np.sqrt(np.mean((result - truth(points)) ** 2))
    assert after < 0.6 * before


@pytest.mark.parametrize("directed", [False, True])
def test_around_the_samples_a_line_goes_on_following_the_speed(directed):
    points = 0.2 + 0.5 * scattered(40, directed)
    if directed:
        points[:, :2] = 0.6 * scattered(40, directed)[:, :2]
    random = np.random.default_rng(4)
    lsf = truth(points) + random.normal(0.0, 0.01, (40, 4))
    around = boundary(points.shape[1])
    result = smoothed(points, lsf, np.full(40, 300.0), around)
    np.testing.assert_array_equal(
        result[:40], smoothed(points, lsf, np.full(40, 300.0), points[:0])
    )
    nearest = lsf[np.square(around[:, None] - points).sum(axis=2).argmin(axis=1)]
    error = np.abs(result[40:] - truth(around)).mean()
    assert error < 0.4 * np.abs(nearest - truth(around)).mean()
    few = smoothed(points[:2], lsf[:2], np.ones(2), around)
    assert set(map(tuple, few)) == set(map(tuple, lsf[:2]))


def test_repeated_visits_come_to_their_weighted_mean():
    points = np.vstack([np.tile([0.5, 0.5], (30, 1)), scattered(4)])
    random = np.random.default_rng(3)
    lsf = np.tile([0.5, 1.5, 2.5], (34, 1)) + random.normal(0.0, 0.02, (34, 3))
    weights = np.where(np.arange(34) % 2, 400.0, 100.0)
    result = smoothed(points, lsf, weights, points[:0])[:30]
    np.testing.assert_allclose(result, np.tile(result[0], (30, 1)), atol=1e-9)
    mean = np.average(lsf[:30], axis=0, weights=weights[:30])
    np.testing.assert_allclose(result[0], mean, atol=0.006)


def test_more_samples_than_the_largest_number_of_nodes_are_smoothed_too():
    count = 3 * LARGEST
    points = scattered(count)
    noise = np.random.default_rng(2).normal(0.0, 0.03, (count, 4))
    result = smoothed(points, truth(points) + noise, np.full(count, 200.0), points[:0])
    assert np.sqrt(np.mean((result - truth(points)) ** 2)) < 0.01


@settings(max_examples=40)
@given(
    count=st.integers(1, 25),
    order=st.integers(1, 12),
    directed=st.booleans(),
    repeated=st.booleans(),
    collinear=st.booleans(),
    strongest=st.floats(0.01, 0.99),
    heaviest=st.floats(1.0, 1e6),
    seed=st.integers(0, 2**16),
)
def test_whatever_the_samples_frequencies_ascend_half_as_far_apart_or_more(
    count, order, directed, repeated, collinear, strongest, heaviest, seed
):
    random = np.random.default_rng(seed)
    points = scattered(count, directed, seed)
    if collinear:
        points[:, 0] = points[:, -1]
    if repeated:
        points[:] = points[0]
    lsf = reflection_to_lsf(random.uniform(-strongest, strongest, (count, order)))
    result = smoothed(points, lsf, random.uniform(1.0, heaviest, count), points[:0])
    assert np.isfinite(result).all()
    assert count >= 4 or (result == lsf).all()

    def gaps(values):
        return np.diff(values, prepend=0.0, append=np.pi, axis=1).min(axis=1)

    assert (gaps(result) >= 0.499 * gaps(lsf)).all()


@pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC], ids=lambda space: space.name)
def test_a_model_of_smoothed_spectra_keeps_its_samples(space):
    points = scattered(30, space.directed)
    lsf = truth(points) + np.random.default_rng(5).normal(0.0, 0.02, (30, 4))
    effective = effective_samples(lsf, np.full(30, 250), 1000.0)
    power = np.random.default_rng(6).uniform(0.5, 2.0, 30)
    samples = TextureSamples(points * space.scale, lsf, 0.2 * power, power, space, effective, 0.01)
    model = TextureModel(samples)
    np.testing.assert_array_equal(model.samples.lsf, lsf)
    at_samples = model.at(*samples.inputs.T)[0]
    np.testing.assert_allclose(at_samples, smoothed_shapes(samples)[:30], atol=1e-9)
    assert np.abs(at_samples - lsf).max() > 1e-3
