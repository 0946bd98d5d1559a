"""All-pole filters stand for filters with zeros: near spectra, equal powers."""

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from mmt.texture.autoregression.forms import reflection_to_ar
from mmt_bridges.hatt.models import all_pole


def random_filter(seed, poles, zeros):
    generator = np.random.default_rng(seed)
    ar = reflection_to_ar(generator.uniform(-0.9, 0.9, poles))
    ma = np.append(1.0, reflection_to_ar(generator.uniform(-0.7, 0.7, zeros))) if zeros else [1.0]
    return ar, generator.uniform(0.1, 10.0) * np.asarray(ma)


def test_poles_alone_stay_what_they_are():
    filters = [random_filter(seed, 6, 0) for seed in range(5)]
    ar = np.array([a for a, _ in filters])
    found = all_pole(ar, np.ones((5, 1)), np.arange(1.0, 6.0))
    np.testing.assert_allclose(reflection_to_ar(found.reflection), ar, atol=1e-9)
    np.testing.assert_allclose(found.variance, np.arange(1.0, 6.0), rtol=1e-9)
    assert found.error_db.max() < 1e-6


@pytest.mark.parametrize("zeros", [2, 4])
def test_the_spectrum_is_near_that_with_zeros(zeros):
    filters = [random_filter(seed, 6, zeros) for seed in range(8)]
    ar, ma = (np.array([pair[end] for pair in filters]) for end in (0, 1))
    found = all_pole(ar, ma, np.full(8, 2.0))
    for row in range(8):
        _, wanted = freqz(ma[row], np.append(1.0, ar[row]), 512)
        poles = np.append(1.0, reflection_to_ar(found.reflection[row]))
        _, near = freqz([np.sqrt(found.variance[row] / 2.0)], poles, 512)
        difference = 20 * np.log10(np.abs(near) / np.abs(wanted))
        assert np.sqrt(np.mean(difference**2)) == pytest.approx(found.error_db[row], abs=0.02)
    assert found.error_db.max() <= 0.1 or found.reflection.shape[1] == 64
    assert found.error_db.max() <= 0.2
    assert found.reflection.shape[1] > 6


def test_a_zero_on_the_unit_circle_is_as_near_as_64_poles_come():
    found = all_pole(np.array([[0.5]]), np.array([[1.0, 0.0, 1.0]]), np.ones(1))
    assert found.reflection.shape == (1, 64)
    assert 0.1 < found.error_db[0] < 3.0
    assert (np.abs(found.reflection) < 1.0).all()


def test_power_is_kept():
    ar, ma = random_filter(3, 5, 3)
    found = all_pole(ar[None], ma[None], np.full(1, 4.0))
    power = found.variance / np.prod(1.0 - found.reflection**2, axis=1)
    response = lfilter(ma, np.append(1.0, ar), np.r_[1.0, np.zeros(40_000)])
    np.testing.assert_allclose(power, 4.0 * response @ response, rtol=1e-9)
