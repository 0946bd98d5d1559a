import math
import sys

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.texture.signals.biquad import (
    LARGEST,
    Biquad,
    BiquadFilter,
    bessel_low_pass,
    butterworth_high_pass,
)

RATE_HZ = 1000.0


def taps(biquad):
    return np.array([biquad.b0, biquad.b1, biquad.b2]), np.array([1.0, biquad.a1, biquad.a2])


def run(biquad, samples):
    stepped = BiquadFilter(biquad)
    return np.array([stepped.step(value) for value in samples.tolist()])


@given(share=st.floats(1e-4, 0.4999), rate_hz=st.sampled_from([100.0, 1000.0, 10_000.0]))
@settings(max_examples=80)
def test_designs_equal_scipys(share, rate_hz):
    cutoff_hz = share * rate_hz
    at_hz = np.array([0.0, cutoff_hz, 0.49 * rate_hz])
    for design, oracle in (
        (bessel_low_pass, scipy.signal.bessel(2, cutoff_hz, fs=rate_hz, norm="mag")),
        (butterworth_high_pass, scipy.signal.butter(2, cutoff_hz, "highpass", fs=rate_hz)),
    ):
        found = design(cutoff_hz, rate_hz)
        np.testing.assert_allclose(taps(found), oracle, atol=1e-12)
        _, response = scipy.signal.freqz(*oracle, at_hz, fs=rate_hz)
        np.testing.assert_allclose(found.gain_at(at_hz), np.abs(response), atol=1e-7)


@pytest.mark.parametrize(
    "biquad",
    [
        bessel_low_pass(20.0, RATE_HZ),
        butterworth_high_pass(10.0, RATE_HZ),
        butterworth_high_pass(300.0, RATE_HZ),
        Biquad(0.7, -0.4, 0.1, -1.1, 0.4, RATE_HZ),
    ],
)
def test_group_delay_equals_scipys(biquad):
    frequencies_hz = np.array([1.0, 7.5, 20.0, 60.0, 150.0, 333.0, 490.0])
    _, oracle = scipy.signal.group_delay(taps(biquad), w=frequencies_hz, fs=RATE_HZ)
    delays = [biquad.delay_samples(at_hz) for at_hz in frequencies_hz]
    np.testing.assert_allclose(delays, oracle, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    ("cutoff_hz", "rate_hz"),
    [
        *((cutoff_hz, 1000.0) for cutoff_hz in (0.0, -5.0, 500.0, 0.05, math.nan)),
        *((10.0, rate_hz) for rate_hz in (0.0, math.nan, math.inf)),
    ],
)
def test_impossible_cutoffs_are_refused(cutoff_hz, rate_hz):
    for design in (bessel_low_pass, butterworth_high_pass):
        with pytest.raises(InputError, match="cutoff"):
            design(cutoff_hz, rate_hz)


def test_settling_bounds_what_is_left_of_a_step():
    for biquad in (bessel_low_pass(20.0, RATE_HZ), butterworth_high_pass(10.0, RATE_HZ)):
        response = run(biquad, np.r_[0.0, np.ones(999)])[1:]
        left = np.abs(response - biquad.gain_at(np.zeros(1)))
        for share in (0.5, 0.05, 1e-6):
            assert left[biquad.settling_samples(share) :].max() <= 2.0 * share
    assert bessel_low_pass(20.0, RATE_HZ).settling_samples(0.05) == 22
    assert butterworth_high_pass(10.0, RATE_HZ).settling_samples(0.05) == 68
    assert Biquad(1.0, 0.0, 0.0, 0.0, 0.0, RATE_HZ).settling_samples(0.01) == 0
    assert Biquad(1.0, 0.0, 0.0, -0.9, 0.0, RATE_HZ).settling_samples(0.5) == 7


def test_equals_scipys_filter_started_in_steady_state():
    samples = 9.81 + np.random.default_rng(3).normal(size=400)
    for biquad in (bessel_low_pass(20.0, RATE_HZ), butterworth_high_pass(10.0, RATE_HZ)):
        b, a = taps(biquad)
        state = scipy.signal.lfilter_zi(b, a) * samples[0]
        oracle, _ = scipy.signal.lfilter(b, a, samples, zi=state)
        np.testing.assert_allclose(run(biquad, samples), oracle, atol=1e-11)
    constant = run(butterworth_high_pass(10.0, RATE_HZ), np.full(50, 9.81))
    np.testing.assert_array_equal(constant, 0.0)


def test_silence_ends_in_exact_zeros_not_in_denormals():
    output = run(butterworth_high_pass(10.0, RATE_HZ), np.r_[0.0, 1.0, np.zeros(4000)])
    assert not np.any((output != 0.0) & (np.abs(output) < sys.float_info.min))
    np.testing.assert_array_equal(output[-1000:], 0.0)


def test_huge_values_stay_finite_and_are_forgotten():
    for design in (bessel_low_pass(20.0, RATE_HZ), butterworth_high_pass(10.0, RATE_HZ)):
        samples = np.r_[0.0, LARGEST, -LARGEST, np.zeros(12_000)]
        output = run(design, samples)
        assert np.abs(output).max() <= 2.0 * LARGEST
        assert output[-1] == 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e200])
def test_what_is_no_measurement_repeats_the_previous_input(bad):
    samples = np.array([1.0, 2.0, bad, bad, -1.0])
    held = np.array([1.0, 2.0, 2.0, 2.0, -1.0])
    biquad = butterworth_high_pass(10.0, RATE_HZ)
    np.testing.assert_array_equal(run(biquad, samples), run(biquad, held))
    leading = run(biquad, np.r_[bad, samples])
    np.testing.assert_array_equal(leading, np.r_[0.0, run(biquad, held)])
