"""Independent samples that the power of a segment is worth: known answers."""

import itertools

import numpy as np
import pytest
from scipy.signal import freqz, lfilter
from scipy.special import digamma, polygamma

from mmt.texture.autoregression.forms import LEAST_SIZE, effective_samples, reflection_to_lsf
from mmt.texture.model.fits import fit_segments, unpacked
from mmt.texture.segmentation.segmenter import Segment
from mmt.texture.settings import ModellingSettings
from mmt.texture.space import ISOTROPIC


def test_white_noise_is_worth_all_its_samples_and_a_first_order_filter_what_bartlett_says():
    filters = np.array([[1e-12], [-0.6], [0.9]])
    found = effective_samples(reflection_to_lsf(filters), np.array([200, 400, 1000]), 1000.0)
    share = (1 - filters[:, 0] ** 2) / (1 + filters[:, 0] ** 2)
    np.testing.assert_allclose(found, share * [200, 400, 1000], rtol=1e-6)


def test_a_line_that_nothing_resolves_is_worth_the_least_and_no_samples_give_none():
    assert effective_samples(np.array([[1.0, 1.0 + 1e-9]]), np.array([150]), 1000.0) == LEAST_SIZE
    assert effective_samples(np.empty((0, 4)), np.empty(0), 1000.0).shape == (0,)


def test_the_power_of_segments_scatters_as_their_effective_length_says():
    random, reflection = np.random.default_rng(3), np.array([-0.8])
    noise = random.standard_normal((4000, 600))
    x = np.zeros(4000)
    kept = []
    for tick in range(600):
        x = 0.8 * x + noise[:, tick]
        if tick >= 300:
            kept.append(x)
    logarithm = np.log(np.mean(np.square(kept), axis=0) * (1 - 0.64))
    effective = effective_samples(reflection_to_lsf(reflection[None]), np.array([300]), 1000.0)
    half = 0.5 * effective[0]  # of a chi-square number over its degrees of freedom
    mean, variance = digamma(half) - np.log(half), polygamma(1, half)
    assert np.mean(logarithm) == pytest.approx(mean, abs=4 * np.sqrt(variance / 4000))
    assert np.var(logarithm) == pytest.approx(variance, rel=0.1)


def test_segments_of_narrow_lines_are_worth_what_their_spectrum_says_whatever_the_order():
    count, random = 300, np.random.default_rng(7)
    modes = [(40.0, 7.0, 2.5), (80.0, 11.0, 1.0), (120.0, 15.0, 0.4), (150.0, 180.0, 0.5)]
    filters = [  # of each mode's frequency and width in Hz
        np.poly([np.exp(np.pi * (-width + 2j * sign * hz) / 1000.0) for sign in (1, -1)]).real
        for hz, width, _ in modes
    ]
    bins = np.linspace(0.0, np.pi, 4097)
    responses = [np.abs(freqz([1.0], taps, bins)[1]) ** 2 for taps in filters]
    gains = [power / r.mean() for r, (_, _, power) in zip(responses, modes, strict=True)]
    density = sum(gain * response for gain, response in zip(gains, responses, strict=True))
    exact = count * density.mean() ** 2 / np.mean(density**2)
    segments = []
    for number in range(60):
        parts = [
            np.sqrt(gain) * lfilter([1.0], taps, random.normal(size=1000 + count))
            for gain, taps in zip(gains, filters, strict=True)
        ]
        start, vibration = 1000 * number, sum(parts)[1000:]
        segments.append(Segment(start, start + count, 100.0, (100.0, 0.0), 1.0, vibration, 0, True))
    for order in (4, 12):
        fits = fit_segments(segments, itertools.count(), ModellingSettings(order=order))
        found = unpacked([fit.packed for fit in fits], ISOTROPIC)
        assert set(found.counts) == {count}
        alone = found.effective
        counts = np.full(60, float(count))
        assert np.log(alone.mean() / exact) == pytest.approx(0.0, abs=0.25)
        rough = effective_samples(found.lsf, counts, 1000.0)
        assert np.log(rough.mean() / exact) > 0.35
