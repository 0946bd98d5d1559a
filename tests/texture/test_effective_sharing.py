"""What segments' powers are worth, told together."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from mmt.texture.autoregression.effective_sample_size import LEAST, effective_samples
from mmt.texture.autoregression.forms import reflection_to_lsf
from mmt.texture.field.level_process import shared_effective
from mmt.texture.model.fits import fit_segments
from mmt.texture.settings import ModellingSettings


def fitted(poles: list[float], counts: np.ndarray) -> np.ndarray:
    return effective_samples(reflection_to_lsf(np.array([[-pole] for pole in poles])), counts)


def plane(speeds: list[float]) -> np.ndarray:
    return np.column_stack([speeds, np.full(len(speeds), 0.5)])


def test_segments_of_one_spectrum_are_worth_what_each_says():
    counts = np.array([200, 300, 500])
    alone = fitted([0.9, 0.9, 0.9], counts)
    np.testing.assert_allclose(shared_effective(plane([0.3, 0.35, 0.4]), counts, alone), alone)


def test_one_that_looks_broad_among_narrow_ones_is_believed_less():
    counts = np.full(4, 300)
    alone = fitted([0.97, 0.97, 0.5, 0.97], counts)
    together = shared_effective(plane([0.3, 0.32, 0.31, 0.33]), counts, alone)
    assert together[2] < 0.25 * alone[2]
    assert together[0] == pytest.approx(together[3], rel=0.01)


def test_at_another_speed_or_along_another_line_the_spectrum_may_be_another():
    counts = np.full(2, 300)
    alone = fitted([0.97, 0.5], counts)
    far = shared_effective(plane([0.03, 0.9]), counts, alone)
    np.testing.assert_allclose(far, alone, rtol=0.02)
    across = np.array([[0.3, 0.0, 0.5], [0.0, 0.3, 0.5]])
    np.testing.assert_allclose(shared_effective(across, counts, alone), alone, rtol=0.1)
    back = np.array([[0.3, 0.0, 0.5], [-0.3, 0.0, 0.5]])
    assert np.ptp(shared_effective(back, counts, alone)) < 1e-6


def test_many_segments_and_the_narrowest_lines_stay_in_range():
    random = np.random.default_rng(1)
    poles = random.uniform(0.0, 0.9999, 900).tolist()
    counts = random.integers(120, 1000, 900)
    alone = fitted(poles, counts)
    found = shared_effective(random.uniform(0.0, 1.0, (900, 2)), counts, alone)
    assert (found >= LEAST).all()
    assert (found <= counts + 1e-6).all()
    single = shared_effective(plane([0.2]), counts[:1], alone[:1])
    np.testing.assert_allclose(single, alone[:1])


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
        start = 1000 * number
        span = SimpleNamespace(start=start, stop=start + count, vibration_m_s2=sum(parts)[1000:])
        segments.append(span)
    for order in (4, 12):
        fits = fit_segments(segments, order, itertools.count(), ModellingSettings())
        assert {fit.count for fit in fits} == {count}
        alone = np.array([fit.effective for fit in fits])
        counts = np.full(60, float(count))
        together = shared_effective(np.tile([0.4, 0.4], (60, 1)), counts, alone)
        assert np.log(together.mean() / exact) == pytest.approx(0.0, abs=0.25)
        rough = effective_samples(np.array([fit.lsf for fit in fits]), counts)
        rough = shared_effective(np.tile([0.4, 0.4], (60, 1)), counts, rough)
        assert np.log(rough.mean() / exact) > 0.35
