import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from selection_samples import sampled_texture

from mmt.texture.selection.outliers import (
    LEAST,
    LIKENESS,
    MODEL_KINDS,
    discriminant_scores,
    find_outliers,
)


def _by_the_definition(excess, accused):
    """Fisher's discriminant, one point at a time, with an explicit inverse."""
    good = excess[~accused]
    covariance = np.atleast_2d(np.cov(good.T, bias=True))
    size = len(covariance)
    inverse = np.linalg.inv(covariance + np.trace(covariance) / size * np.eye(size))
    middle = np.median(good, axis=0)
    result = []
    for index, row in enumerate(excess):
        others = accused & (np.arange(len(excess)) != index)
        result.append((row - middle) @ inverse @ (excess[others].mean(axis=0) - middle))
    return np.array(result)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(LEAST, 15), st.integers(1, 12))
def test_scores_are_fishers_discriminant_without_the_point_itself(seed, count, size):
    generator = np.random.default_rng(seed)
    excess = generator.normal(size=(40, size))
    accused = np.arange(40) < count
    expected = _by_the_definition(excess, accused)
    np.testing.assert_allclose(
        discriminant_scores(excess, accused),
        expected,
        rtol=1e-9,
        atol=1e-9 * np.abs(expected).max(),
    )


def test_a_point_that_has_what_the_accused_have_stands_out():
    generator = np.random.default_rng(1)
    excess = generator.normal(size=(200, 30))
    excess[:21, 10:15] += 3.0
    accused = np.arange(200) < 20  # the last of those with the bump is not accused
    found = discriminant_scores(excess, accused)
    assert found[20] > found[21:].max()


@pytest.mark.parametrize("count", [0, LEAST - 1, 40 - LEAST + 1, 40])
def test_too_few_on_either_side_have_nothing_in_common(count):
    excess = np.random.default_rng(2).normal(size=(40, 5))
    assert not discriminant_scores(excess, np.arange(40) < count).any()


@pytest.mark.parametrize("value", [0.0, 1e-300, 1e150])
def test_points_that_are_all_the_same_are_all_alike(value):
    found = discriminant_scores(np.full((40, 5), value), np.arange(40) < 10)
    assert np.isfinite(found).all()
    assert np.ptp(found) == 0.0


def test_the_discriminant_finds_more_knocks_in_the_models_data_alone():
    data, knocked = sampled_texture(160, 2, knocks=16, seed=1)
    alone = find_outliers(type(data)(data.points, data.lsf, data.variance))
    assert alone.evidence.kinds == (*MODEL_KINDS, LIKENESS)
    assert alone.outlier[knocked].mean() >= 0.5
