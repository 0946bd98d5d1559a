"""Outliers among fitted segments: the rate of false alarms, and what is found."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from selection_samples import ORDER, sampled_texture

from mmt.core.errors import InputError
from mmt.texture.field.covariance import coordinates, prior_covariance, settings
from mmt_methods.selection import ModelPoints
from mmt_methods.selection.outliers import FALSE_ALARMS, MOST, find_outliers, limit_of, reasons
from mmt_methods.selection.points import band
from mmt_methods.selection.transients import whitening


def drawn_from_the_prior(n, dimensions, seed, *, gain_spread=0.0, knocks=0):
    """Return segments of a texture drawn from the field's prior, and which hold a knock.

    ``gain_spread`` is that of a gain of each segment, of Student's distribution with 4 degrees.
    """
    generator = np.random.default_rng(seed)
    points = generator.uniform(0.05, 1.0, (n, dimensions))
    at = coordinates(points)
    directed = dimensions == 3
    setting = np.median(settings(16, directed=directed, rough=False), axis=0)
    prior = prior_covariance(at, at, setting) - 15.5  # levels that are less free than by 16
    root = np.linalg.cholesky(prior + 1e-9 * np.eye(n))
    cepstra = root @ generator.normal(size=(n, 4)) * np.array([1.0, 0.4, 0.3, 0.2])
    waves = np.cos(2.0 * np.pi * np.outer(np.arange(4), band()))
    filters = whitening(np.exp(at.law[:, None] + cepstra @ waves), ORDER)
    gains = np.exp(0.5 * gain_spread * generator.standard_t(4.0, n))
    knocked = np.zeros(n, dtype=np.bool_)
    knocked[generator.choice(n, knocks, replace=False)] = True
    segments = []
    for ar, variance, gain, hit in zip(*filters, gains, knocked, strict=True):
        noise = gain * np.sqrt(variance) * generator.normal(size=600)
        segment = lfilter([1.0], np.append(1.0, ar), noise)[300:]
        if hit:
            ring = np.exp(-np.arange(180) / 20.0) * np.sin(0.9 * np.arange(180))
            segment[120:] += ring * np.sqrt(0.4 / np.square(ring).sum() * 300) * segment.std()
        segments.append(segment)
    return ModelPoints.fitted(points, segments, ORDER, 1000.0), knocked


@pytest.mark.parametrize("with_segments", [True, False], ids=["segments", "model"])
@pytest.mark.parametrize(
    ("gain_spread", "rate"),
    [(0.0, FALSE_ALARMS), (0.5, 2.0 * FALSE_ALARMS)],
    ids=["normal", "heavy"],
)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_rate_of_false_alarms_holds_whatever_the_scatter(
    dimensions, gain_spread, rate, with_segments
):
    shares = []
    for seed in range(5):
        data, _ = drawn_from_the_prior(100, dimensions, seed, gain_spread=gain_spread)
        data = data if with_segments else replace(data, segments=None)
        shares.append(find_outliers(data).outlier.mean())
    assert np.mean(shares) <= rate


@pytest.mark.parametrize("dimensions", [2, 3])
def test_knocks_on_a_texture_of_the_prior_are_found(dimensions):
    for seed in range(2):
        data, knocked = drawn_from_the_prior(100, dimensions, seed, knocks=10)
        found = find_outliers(data)
        assert found.outlier[knocked].mean() >= 0.9
        assert found.outlier[~knocked].mean() <= 0.05
        np.testing.assert_array_equal(found.outlier, found.score > found.limit)
        np.testing.assert_allclose(found.score, found.parts.sum(axis=1))
        assert [bool(words) for words in reasons(found)] == found.outlier.tolist()
        told = [float(re.search(r"score ([\d.]+),", words)[1]) for words in reasons(found) if words]
        np.testing.assert_allclose(told, found.score[found.outlier], atol=0.051)


@pytest.mark.parametrize("n", [12, 20, 100, 1000])
def test_another_exponential_score_is_above_the_limit_at_the_rate(n):
    generator = np.random.default_rng(n)
    above = []
    for _ in range(2000):
        scores = 5.0 * generator.exponential(size=n)
        stayed = scores[scores <= np.quantile(scores, 0.98)]
        above.append(np.exp(-limit_of(stayed, 0.02) / 5.0))
    assert np.mean(above) == pytest.approx(0.02, rel=0.4)


@given(st.lists(st.floats(0.0, 1e6), min_size=6, max_size=60), st.floats(0.001, 0.2))
def test_limits_are_finite_and_above_the_median(scores, rate):
    values = np.array(scores)
    limit = limit_of(values, rate)
    assert np.isfinite(limit)
    assert limit > np.median(values)
    assert limit_of(values + 7.0, rate) == pytest.approx(limit + 7.0, rel=1e-9)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_of_few_points_none_is_accused(n):
    data, _ = sampled_texture(n, 2, knocks=0)
    assert find_outliers(data) is None


@pytest.mark.parametrize("n", [12, 20])
def test_among_few_points_a_loud_knock_is_found_and_nothing_else(n):
    data, _ = sampled_texture(n, 2, knocks=0, seed=3)
    assert not find_outliers(data).outlier.any()
    ring = np.exp(-np.arange(130) / 20.0) * np.sin(0.9 * np.arange(130))
    segments = list(data.segments)
    segments[2] = segments[2] + 20.0 * segments[2].std() * np.append(np.zeros(130), ring)
    struck = ModelPoints.fitted(data.points, segments, ORDER, 1000.0)
    np.testing.assert_array_equal(np.flatnonzero(find_outliers(struck).outlier), [2])


def test_repeated_equal_and_silent_points_are_no_outliers():
    data, _ = sampled_texture(40, 2, knocks=0)
    repeated = np.repeat(np.arange(20), 2)
    each = (sampled_texture(40, 2, knocks=0, seed=seed)[0] for seed in range(4))
    assert np.mean([find_outliers(one.subset(repeated)).outlier for one in each]) <= 0.1
    equal = ModelPoints(data.points, np.tile(data.lsf[0], (40, 1)), np.ones(40))
    assert not find_outliers(equal).outlier.any()
    silent = replace(data, segments=[np.zeros(260)] * 5 + list(data.segments[5:]))
    assert not find_outliers(silent).outlier[:5].any()
    one_place = find_outliers(replace(data, points=np.full((40, 2), 0.5)))
    assert np.isfinite(one_place.score).all()


@pytest.mark.parametrize("factor", [1e-290, 1e290])
def test_levels_far_from_their_segments_leave_every_score_finite(factor):
    data, _ = sampled_texture(12, 2, knocks=0)
    variance = np.where(np.arange(12) == 3, factor, data.variance)
    loud = [segment * 1e8 if i == 5 else segment for i, segment in enumerate(data.segments)]
    assert np.isfinite(find_outliers(replace(data, variance=variance, segments=loud)).score).all()


@pytest.mark.parametrize("dimensions", [1, 4])
def test_other_inputs_are_refused(dimensions):
    generator = np.random.default_rng(0)
    points = generator.random((20, dimensions))
    data = ModelPoints(points, np.tile([1.0, 2.0], (20, 1)), np.ones(20))
    with pytest.raises(InputError, match="two or three"):
        find_outliers(data)
    if dimensions == 4:
        with pytest.raises(InputError, match="not negative"):
            find_outliers(replace(data, points=points[:, :2] - 0.5))


def test_more_false_alarms_that_are_allowed_are_more_found():
    data, _ = drawn_from_the_prior(120, 2, 3, gain_spread=0.5, knocks=12)
    counts = [find_outliers(data, rate).outlier.sum() for rate in (0.001, 0.02, 0.2)]
    assert counts == sorted(counts)
    assert counts[0] < counts[2] <= MOST * 120
