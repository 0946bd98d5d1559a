"""A stream changes its sampling rate without changing what is heard."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import firwin

from mmt.core.errors import InputError
from mmt.rendering.generating import RateConverter


@cache
def whole(from_hz, to_hz):
    return RateConverter(from_hz, to_hz).convert(NOISE)


NOISE = np.random.default_rng(1).standard_normal(41_000)
PAIRS = [(1000, 2000), (1000, 44_100), (1000, 48_000), (10_000, 2000), (2000, 1000), (1000, 8192)]


@given(st.sampled_from(PAIRS), st.lists(st.integers(0, 400), min_size=1, max_size=20))
@settings(max_examples=40)
def test_the_size_of_blocks_does_not_matter(pair, counts):
    converter, position, parts = RateConverter(*pair), 0, []
    for count in counts:
        needed = converter.needed(count)
        parts.append(converter.convert(NOISE[position : position + needed], count))
        position += needed
        assert len(parts[-1]) == count
    joined = np.concatenate(parts)
    np.testing.assert_allclose(joined, whole(*pair)[: len(joined)], atol=1e-12)


@pytest.mark.parametrize(("from_hz", "to_hz"), PAIRS)
@pytest.mark.parametrize("part", [0.02, 0.2, 0.39])
def test_a_sine_comes_out_as_it_went_in(from_hz, to_hz, part):
    frequency = part * min(from_hz, to_hz)
    sine = np.sin(2 * np.pi * frequency * np.arange(from_hz) / from_hz)
    converter = RateConverter(from_hz, to_hz)
    found = converter.convert(sine)
    assert len(found) == pytest.approx(to_hz, abs=2)
    settled = slice(len(found) // 4, None)
    time_s = np.arange(len(found)) / to_hz - converter.delay_s
    wanted = np.sin(2 * np.pi * frequency * time_s)
    np.testing.assert_allclose(found[settled], wanted[settled], atol=0.006)


@pytest.mark.parametrize(("from_hz", "to_hz"), [(10_000, 2000), (2000, 1000)])
def test_what_the_device_cannot_play_does_not_fold_back(from_hz, to_hz):
    high = np.sin(2 * np.pi * 0.62 * to_hz * np.arange(from_hz) / from_hz)
    found = RateConverter(from_hz, to_hz).convert(high)
    assert np.abs(found[len(found) // 4 :]).max() < 10 ** (-50 / 20)


@pytest.mark.parametrize(("from_hz", "to_hz"), PAIRS)
def test_the_filter_is_the_window_methods(from_hz, to_hz):
    """Each phase has the taps of scipy's Kaiser-windowed sinc, scaled to pass what is constant."""
    common = math.gcd(from_hz, to_hz)
    up, down = to_hz // common, from_hz // common
    taps = math.ceil(16 * max(1.0, down / up))
    prototype = firwin(up * taps, 1.0 / max(up, down), window=("kaiser", 5.4), scale=False)
    wanted = prototype.reshape(taps, up).T
    found = RateConverter(from_hz, to_hz).phases[:, ::-1]
    np.testing.assert_allclose(found, wanted / wanted.sum(axis=1, keepdims=True), atol=1e-15)


def test_equal_rates_pass_samples_through():
    samples = np.random.default_rng(2).standard_normal(100)
    converter = RateConverter(1000, 1000)
    assert converter.needed(7) == 7
    np.testing.assert_array_equal(converter.convert(samples), samples)
    assert converter.delay_s == 0


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_that_is_none_is_refused(rate_hz):
    with pytest.raises(InputError, match="sampling rate"):
        RateConverter(1000, rate_hz)
    with pytest.raises(InputError, match="no simple fraction"):
        RateConverter(1000.01, 44_100.07)
