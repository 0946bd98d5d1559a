"""What the high-pass takes is given back to spectra and powers: known answers, extremes."""

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import freqz, lfilter

from mmt.texture.autoregression.burg import (
    LARGEST_OF_SPECTRA,
    ReflectionFits,
    reflection_of,
    relative_density,
)
from mmt.texture.autoregression.forms import (
    lsf_spectrum,
    lsf_to_reflection,
    reflection_to_ar,
    reflection_to_lsf,
)
from mmt.texture.field.cells import FieldCells
from mmt.texture.field.posterior import LevelField
from mmt.texture.model.fits import fit_segments, gain_without_high_pass, unpacked, without_high_pass
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.segmentation.segmenter import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ, butterworth_high_pass
from mmt.texture.space import ISOTROPIC, TextureSamples

PERIOD = 1024
FREQUENCIES_HZ = np.arange(PERIOD // 2 + 1) * (1000.0 / PERIOD)
FLAT = np.array([[0.3, -0.2]])
SLOW = np.array([[-0.9925, 0.97]])
"""A line at 19 Hz."""


def left(frequencies_hz):
    """The share of a power that the modelling's own filter leaves."""
    f = butterworth_high_pass(VIBRATION_CUTOFF_HZ, 1000.0)
    _, response = freqz([f.b0, f.b1, f.b2], [1.0, f.a1, f.a2], worN=frequencies_hz, fs=1000.0)
    return np.abs(response) ** 2


@pytest.mark.parametrize("reflection", [FLAT, SLOW])
def test_a_spectrum_comes_back_from_what_the_filter_leaves_of_it(reflection):
    before = relative_density(reflection_to_ar(reflection), PERIOD)
    behind, power = reflection_of(before * left(FREQUENCIES_HZ), 40)
    fits = ReflectionFits(behind, np.ones((1, 41)))
    restored, gain = without_high_pass(fits, None, 2, 1000.0, 1000.0)
    _, whole = reflection_of(before, 2)
    heard = (FREQUENCIES_HZ >= 12.0)[None]
    ratio_db = 10 * np.log10(relative_density(reflection_to_ar(restored), PERIOD) / before)
    ratio_db -= ratio_db[heard].mean()
    assert np.abs(ratio_db[heard]).max() < 1.0
    assert gain[0] == pytest.approx(whole[0] / power[0], rel=0.08)  # some below 8 Hz stays lost
    again = gain_without_high_pass(reflection_to_lsf(reflection), 1000.0)
    assert again[0] == pytest.approx(gain[0], rel=0.05)


@settings(max_examples=50)
@given(
    st.lists(st.floats(-LARGEST_OF_SPECTRA, LARGEST_OF_SPECTRA), min_size=1, max_size=24),
    st.integers(1, 24),
    st.sampled_from([200.0, 1000.0, 10_000.0]),
    st.sampled_from([1, 10]),
)
@example([-LARGEST_OF_SPECTRA, -LARGEST_OF_SPECTRA], 1, 200.0, 10)
@example([LARGEST_OF_SPECTRA, 0.9], 9, 200.0, 10)  # two frequencies merge
def test_whatever_was_fitted_the_filter_is_stable_and_has_no_less_power(
    values, order, rate_hz, per_frame
):
    fits = ReflectionFits(np.array([values]), np.ones((1, len(values) + 1)))
    means = fits if per_frame > 1 else None
    reflection, gain = without_high_pass(fits, means, order, rate_hz, rate_hz / per_frame)
    assert reflection.shape == (1, order)
    assert np.abs(reflection).max() < 1.0
    assert 1.0 <= gain[0] * (1.0 + 1e-9) < 1.0 + 2.5  # 1 / 0.29 at most
    lsf = reflection_to_lsf(reflection)
    assert (np.diff(lsf, prepend=0.0, append=np.pi, axis=1) > 0.0).all()
    assert 1.0 <= gain_without_high_pass(lsf, rate_hz)[0] < 1.0 + 2.5


def test_smoothed_fits_are_of_the_vibration_before_the_filter_and_measured_ones_behind():
    f = butterworth_high_pass(VIBRATION_CUTOFF_HZ, 1000.0)
    random, taps = np.random.default_rng(4), np.r_[1.0, reflection_to_ar(FLAT)[0]]
    segments = []
    for number in range(160):
        whole = lfilter([1.0], taps, random.standard_normal(800))[200:]
        behind = lfilter([f.b0, f.b1, f.b2], [1.0, f.a1, f.a2], whole)[200:]
        start = 400 * number
        segments.append(Segment(start, start + 400, 100.0, (100.0, 0.0), 1.0, behind, 0, True))
    low_hz = np.arange(10.0, 16.0)
    truth = lsf_spectrum(reflection_to_lsf(FLAT), np.ones(1), low_hz, 1000.0).mean()
    off_db = {}
    methods = ("published", "field")
    for method in methods:
        fits = fit_segments(segments, itertools.count(), ModellingSettings(method=method, order=8))
        found = unpacked([fit.packed for fit in fits], ISOTROPIC)
        mean = lsf_spectrum(found.lsf, found.variance, low_hz, 1000.0).mean()
        off_db[method] = 10 * np.log10(mean / truth)
        left = np.prod(1 - lsf_to_reflection(found.lsf) ** 2, axis=1)
        np.testing.assert_allclose(found.variance, found.power * left, rtol=0.02)
    assert off_db["published"] < -1.5
    assert abs(off_db["field"]) < 1.0


def test_blocks_get_back_what_the_nearest_filter_says():
    inputs = np.array([[60.0, 0.5], [200.0, 2.0]])
    lsf = reflection_to_lsf(np.vstack([SLOW, FLAT]))
    samples = TextureSamples(inputs, lsf, np.ones(2), np.ones(2))
    cells = FieldCells.from_blocks(samples.points, np.array([2.0, 5.0]), np.array([0, 10]))
    plain = LevelField(cells)
    model = TextureModel(samples, field=cells)
    more_db = model.level_db(*inputs.T)[0] - plain.level_db(samples.points)[0]
    gains_db = 10 * np.log10(gain_without_high_pass(lsf, 1000.0))
    assert more_db[0] == pytest.approx(gains_db[0], abs=0.2)
    assert more_db[1] < 0.5 * more_db[0]
