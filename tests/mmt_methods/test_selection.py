from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RBFInterpolator
from scipy.signal import lfilter
from selection_samples import ORDER, sampled_texture, true_lsf

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import lsf_spectrum, lsf_to_ar
from mmt_methods.selection import ModelPoints, SelectionSettings, select
from mmt_methods.selection.outliers import find_outliers
from mmt_methods.selection.points import amplitude_of, band, spectral_error
from mmt_methods.selection.published import (
    SMOOTHING,
    TAU_1,
    TAU_2,
    local_sparsity,
    select_published,
    thresholds,
    valid_filter,
)
from mmt_methods.selection.selecting import condense
from mmt_methods.selection.transients import (
    LEFT_MS,
    loudest_tone_energy,
    modes,
    tone_evidence,
    whitening,
)


@pytest.fixture(scope="module")
def plane():
    return sampled_texture(160, 2, knocks=16, seed=1)


@pytest.fixture(scope="module")
def space():
    return sampled_texture(200, 3, knocks=20, seed=2)


def trained_anew(data, ridge):
    """Algorithm 1 with a network of scipy for every point."""
    points = (data.points - data.points.min(axis=0)) / np.ptp(data.points, axis=0)
    values = np.column_stack([data.lsf, data.variance])
    truth = amplitude_of(data.lsf, data.variance)
    limit, n = thresholds(points), len(points)

    def missed(index, present):
        present = present.copy()
        present[index] = False
        places, numbers = np.unique(points[present], axis=0, return_inverse=True)
        counts = np.bincount(numbers)
        means = np.array([values[present][numbers == k].mean(axis=0) for k in range(len(places))])
        model = RBFInterpolator(places, means, smoothing=ridge / counts, degree=1)
        predicted = model(points[index : index + 1])[0]
        lsf, variance = valid_filter(predicted[:-1], predicted[-1])
        return spectral_error(amplitude_of(lsf[None], np.array([variance]))[0], truth[index])

    present, outlier = np.ones(n, dtype=bool), np.zeros(n, dtype=bool)
    error = np.full(n, np.nan)
    for index in np.flatnonzero(np.isfinite(limit)):
        error[index] = missed(index, present)
        outlier[index] = error[index] > limit[index]
        present[index] = not outlier[index]
    kept = np.isnan(limit)
    for index in np.flatnonzero(~outlier & np.isfinite(limit)):
        kept[index] = missed(index, kept) > TAU_2
    return outlier, kept, error


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("smoothing", [SMOOTHING, 0.0])
def test_the_published_decisions_are_those_of_training_for_every_point(dimensions, smoothing):
    data, _ = sampled_texture(70, dimensions, knocks=7, seed=3)
    fast = select_published(data, smoothing=smoothing)
    outlier, kept, error = trained_anew(data, smoothing)
    np.testing.assert_array_equal(fast.outlier, outlier)
    np.testing.assert_array_equal(fast.kept, kept)
    np.testing.assert_allclose(fast.error, error, rtol=1e-6)


def test_points_at_one_place_are_left_out_of_the_published_network_one_by_one(plane):
    data, _ = plane
    few = data.subset(np.append(np.arange(60), [20, 20]))
    _, _, error = trained_anew(few, SMOOTHING)
    twins = [20, -2, -1]
    assert np.isfinite(error[twins]).all()
    np.testing.assert_allclose(select_published(few).error[twins], error[twins], rtol=1e-6)


def test_thresholds_are_those_of_the_paper(plane):
    data, _ = plane
    sparsity = local_sparsity(data.points)
    average = np.nanmean(sparsity)
    alpha = TAU_1 * np.nanmean(np.abs(sparsity - average)) / average
    expected = TAU_1 + alpha * (sparsity / average - 1.0)
    np.testing.assert_allclose(thresholds(data.points), expected)
    assert np.nanmean(expected) == pytest.approx(TAU_1)


def test_the_published_result_depends_on_the_order_and_ours_does_not(space, monkeypatch):
    for name, tau in (("TAU_1", 0.15), ("TAU_2", 0.2)):
        monkeypatch.setattr(f"mmt_methods.selection.published.{name}", tau)
    data, _ = space
    generator = np.random.default_rng(0)
    published, ours = set(), set()
    for _ in range(4):
        order = generator.permutation(len(data))
        shuffled = data.subset(order)
        for sets, result in ((published, select_published(shuffled)), (ours, select(shuffled))):
            sets.add((frozenset(order[result.kept]), frozenset(order[result.outlier])))
    assert len(ours) == 1
    assert len(published) > 1


@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_scores_and_reasons_follow_their_points_through_any_shuffle(seed):
    data, _ = sampled_texture(50, 2, knocks=4, seed=5)
    order = np.random.default_rng(seed).permutation(50)
    straight, shuffled = select(data), select(data.subset(order))
    np.testing.assert_array_equal(shuffled.score, straight.score[order])
    np.testing.assert_array_equal(shuffled.kept, straight.kept[order])
    assert shuffled.reason == tuple(straight.reason[i] for i in order)


def test_the_models_data_alone_give_fewer_but_some(plane):
    data, knocked = plane
    alone = select(replace(data, segments=None))
    assert alone.outlier[knocked].mean() >= 0.5
    assert alone.outlier[~knocked].mean() <= 0.05  # of 144: seven
    assert {reason.split(" (")[0] for reason in alone.reason if reason} <= {
        "its spectrum has more than that of strokes like it",
        "it is louder than strokes like it",
    }


def test_what_is_kept_meets_the_threshold_and_holds_the_hull(plane):
    data, _ = plane
    result = select(data, SelectionSettings(tau=0.15))
    assert result.kept[result.minimal].all()
    assert (result.error[result.redundant] <= 0.15).all()
    assert result.compression > 1.5
    assert not (result.kept & result.outlier).any()
    assert (result.kept | result.outlier | result.redundant).all()


def test_a_smaller_threshold_keeps_more_and_zero_keeps_everything(plane):
    data, _ = plane
    counts = [select(data, SelectionSettings(tau=tau)).kept.sum() for tau in (0.3, 0.15, 0.08)]
    assert counts == sorted(counts)
    everything = select(data, SelectionSettings(tau=0))
    np.testing.assert_array_equal(everything.kept, ~everything.outlier)


def test_no_more_than_the_largest_number_is_kept(plane):
    data, _ = plane
    result = select(data, SelectionSettings(tau=0.02, largest=40))
    assert result.kept.sum() == 40
    assert select(data, SelectionSettings(largest=1)).kept.sum() == result.minimal.sum()


def test_of_points_in_one_place_the_most_typical_is_kept():
    data, _ = sampled_texture(150, 2, knocks=0, seed=7)
    points = data.points.copy()
    points[:20] = 0.5 + 0.01 * np.random.default_rng(1).random((20, 2))
    points[20:] += 0.2 * np.sign(points[20:] - 0.5) + 0.2  # nothing else in the middle
    points[:20] += 0.2
    lsf = true_lsf(points)
    lsf[:20, 2] += 0.08  # what is there cannot be told from around it
    lsf[0, 2:4] = lsf[0, 2:4].mean() + np.array([-0.01, 0.01])  # a peak of its own
    odd = ModelPoints(points, lsf, np.ones(150))
    thin = condense(odd, tau=0.1)
    assert not thin.kept[0]
    assert thin.kept[:20].any()


def test_whitening_from_a_spectrum_gives_the_filter_it_came_from():
    lsf = true_lsf(np.random.default_rng(9).random((12, 2)))
    variance = np.linspace(0.1, 5.0, 12)
    filters = whitening(lsf_spectrum(lsf, variance, band(512), 1.0), ORDER)
    np.testing.assert_allclose(filters.ar, lsf_to_ar(lsf), atol=1e-6)
    np.testing.assert_allclose(filters.variance, variance, rtol=1e-6)


def test_segments_too_short_to_tell_or_silent_say_nothing():
    lsf = true_lsf(np.full((3, 2), 0.5))
    filters = whitening(lsf_spectrum(lsf, np.ones(3), band(), 1.0), ORDER)
    segments = [np.zeros(0), np.ones(ORDER + 20), np.zeros(300)]
    found = tone_evidence(segments, filters, np.array([0.1, 1e-9, 1e3]), 1000.0)
    np.testing.assert_array_equal(found[:2], 0.0)
    assert found[2] == pytest.approx(-np.log(300 - ORDER))


def test_equal_points_and_levels_from_tiny_to_huge_do_no_harm():
    data, _ = sampled_texture(40, 2, knocks=0)
    one_place = replace(data, points=np.full((40, 2), 0.5))
    assert select(one_place).kept.any()
    for factor in (1e-200, 1e200):
        segments = [segment * np.sqrt(factor) for segment in data.segments]
        scaled = replace(data, variance=data.variance * factor, segments=segments)
        np.testing.assert_array_equal(select(scaled).kept, select(data).kept)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"points": np.zeros((4, 2))}, "lsf"),
        ({"variance": np.zeros(6)}, "positive"),
        ({"points": np.full((6, 2), np.nan)}, "finite"),
        ({"lsf": np.ones((6, 4))}, "ascend"),
        ({"segments": [np.zeros(3)]}, "segments"),
    ],
)
def test_bad_points_are_refused_with_a_reason(change, words):
    points = np.random.default_rng(0).random((6, 2))
    data = ModelPoints(points, true_lsf(np.zeros((6, 2))), np.ones(6))
    with pytest.raises(InputError, match=words):
        replace(data, **change)


@pytest.mark.parametrize("bad", [{"tau": -1}, {"false_alarms": 0}, {"largest": 0}, {"tau": np.nan}])
def test_bad_settings_are_refused(bad):
    with pytest.raises(InputError):
        SelectionSettings(**bad)


@given(st.lists(st.floats(-1, 4), min_size=1, max_size=20), st.floats(-2, 2))
def test_whatever_an_interpolator_gives_becomes_a_filter(values, variance):
    lsf, positive = valid_filter(np.array(values), variance)
    assert (np.diff(lsf, prepend=0.0, append=np.pi) > 0).all()
    assert positive > 0


def explained_by_least_squares(error, ar, mode, start):
    tone = mode ** np.arange(len(error) - start)
    filtered = lfilter(np.append(1.0, ar), 1.0, tone)
    columns = np.zeros((len(error), 2))
    columns[start:] = np.column_stack([filtered.real, filtered.imag])
    left = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
    return float(error @ error - left @ left)


def test_the_loudest_ring_is_what_least_squares_explains():
    generator = np.random.default_rng(3)
    ar = lsf_to_ar(true_lsf(np.full((1, 2), 0.4)))[0]
    error = generator.normal(size=90)
    grid = modes(1000.0)[::6].copy()
    found = loudest_tone_energy(error, ar, grid, LEFT_MS)
    everywhere = [
        explained_by_least_squares(error, ar, mode, start) for mode in grid for start in range(83)
    ]
    assert found == pytest.approx(max(everywhere), rel=1e-6)


def test_tone_evidence_is_the_ratio_of_likelihoods_at_the_likeliest_levels():
    generator = np.random.default_rng(5)
    lsf = true_lsf(np.full((1, 2), 0.4))
    filters = whitening(lsf_spectrum(lsf, np.ones(1), band(), 1.0), ORDER)
    noise = 1.2 * generator.normal(size=400)
    segment = lfilter([1.0], np.append(1.0, lsf_to_ar(lsf)[0]), noise)[100:]
    error = lfilter(np.append(1.0, filters.ar[0]), 1.0, segment)[ORDER:]
    energy = error @ error / filters.variance[0]
    tone = loudest_tone_energy(error, filters.ar[0], modes(1000.0), LEFT_MS)
    tone /= filters.variance[0]
    offsets = np.linspace(-3.0, 3.0, 60001)
    for variance in (1e-4, 0.2, 50.0):
        prior = 0.5 * error.size * offsets + 0.5 * offsets**2 / variance
        without, with_tone = (
            (prior + 0.5 * e * np.exp(-offsets)).min() for e in (energy, energy - tone)
        )
        expected = without - with_tone - np.log(error.size)
        found = tone_evidence([segment], filters, np.array([variance]), 1000.0)[0]
        assert found == pytest.approx(expected, abs=1e-5)


@given(st.integers(2, 10), st.floats(30.0, 300.0), st.floats(0.0, 6.0))
def test_a_ring_is_heard_alike_at_every_rate(samples, frequency_hz, phase):
    def explained(rate_hz):
        time_s = np.arange(0.2 * rate_hz) / rate_hz
        ring = np.exp(-time_s / 0.025) * np.cos(2 * np.pi * frequency_hz * time_s + phase)
        left = round(LEFT_MS * rate_hz / 1000.0)
        return loudest_tone_energy(ring, np.zeros(1), modes(rate_hz), left) / (ring @ ring)

    assert explained(1000.0 * samples) == pytest.approx(explained(1000.0), abs=0.1)


def test_knocks_are_told_at_4_khz_as_well():
    rate_hz, order, generator = 4000.0, 32, np.random.default_rng(8)
    points = generator.random((40, 2))
    time_s = np.arange(1600) / rate_hz
    ring = np.exp(-time_s / 0.025) * np.sin(2 * np.pi * 60.0 * time_s)
    pole = 0.995 * np.exp(2j * np.pi * 170.0 / rate_hz)
    texture = np.poly([pole, pole.conj()])  # a line of 6 Hz, between two frequencies 21 Hz apart
    segments = []
    for index in range(len(points)):
        noise = generator.standard_normal(2000)
        segment = lfilter([1.0], texture, noise)[400:]
        if index < 4:
            segment[400:] += 0.7 * segment.std() * np.sqrt(1200 / (ring @ ring)) * ring[:1200]
        segments.append(segment)
    data = ModelPoints.fitted(points, segments, order, rate_hz)
    assert data.frequencies == 384
    found = find_outliers(data)
    np.testing.assert_array_equal(np.flatnonzero(found.outlier), np.arange(4))
