import autoregressive_oracles as oracles
import mpmath
import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.signal import freqz

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import (
    ar_spectra,
    ar_spectrum,
    lsf_spectrum,
    lsf_to_ar,
    output_power,
    reflection_to_ar,
    reflection_to_lsf,
)

RATE_HZ = 1000.0
FREQUENCIES_HZ = np.linspace(0, 500, 4001)


def reflection_of(order):
    return np.random.default_rng(order).uniform(-0.5, 0.5, order)


@pytest.mark.parametrize("order", [1, 2, 3, 8, 15, 24])
def test_the_densities_agree_with_a_frequency_response(order):
    ar = reflection_to_ar(reflection_of(order))
    _, response = freqz([1.0], [1.0, *ar], worN=FREQUENCIES_HZ, fs=RATE_HZ)
    expected = 2 * 3.0 / RATE_HZ * np.abs(response) ** 2
    lsf = reflection_to_lsf(reflection_of(order))
    np.testing.assert_allclose(ar_spectrum(ar, 3.0, FREQUENCIES_HZ, RATE_HZ), expected, rtol=1e-9)
    np.testing.assert_allclose(lsf_spectrum(lsf, 3.0, FREQUENCIES_HZ, RATE_HZ), expected, rtol=1e-9)


@pytest.mark.parametrize(("order", "period"), [(1, 4), (16, 1000), (64, 10000)])
def test_densities_from_0_to_half_the_rate_are_those_at_each_frequency(order, period):
    ar = reflection_to_ar(np.array([reflection_of(order), reflection_of(order) / 2]))
    frequencies_hz = np.linspace(0.0, RATE_HZ / 2, period // 2 + 1)
    expected = ar_spectrum(ar, np.array([1.0, 3.0]), frequencies_hz, RATE_HZ)
    found = ar_spectra(ar, np.array([1.0, 3.0]), period, RATE_HZ)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2, 7, 16])
def test_the_integral_is_the_power(order):
    reflection = reflection_of(order)
    density = ar_spectrum(reflection_to_ar(reflection), 0.7, FREQUENCIES_HZ, RATE_HZ)
    power = trapezoid(density, FREQUENCIES_HZ)
    assert power == pytest.approx(output_power(0.7, reflection), rel=1e-9)


def test_a_batch_is_its_rows():
    reflection = np.array([reflection_of(6), reflection_of(6) / 2])
    variance = np.array([1.0, 0.0])
    for spectrum, form in (
        (ar_spectrum, reflection_to_ar(reflection)),
        (lsf_spectrum, reflection_to_lsf(reflection)),
    ):
        batch = spectrum(form, variance, FREQUENCIES_HZ, RATE_HZ)
        assert batch.shape == (2, len(FREQUENCIES_HZ))
        for row in range(2):
            single = spectrum(form[row], variance[row], FREQUENCIES_HZ, RATE_HZ)
            np.testing.assert_allclose(batch[row], single, rtol=1e-12)


@pytest.mark.parametrize("order", [30, 31])
def test_the_frequencies_keep_the_digits_of_a_low_pass_filter(order):
    lsf = oracles.low_pass_lsf(order)
    ar = oracles.lsf_to_ar(lsf)
    for frequency_hz in (0.0, 20.0, 60.0, 350.0, 500.0):
        with mpmath.workdps(100):
            angle = mpmath.mpf(frequency_hz) * 2 * mpmath.pi / 1000
            response = 1 + sum(a * mpmath.expj(-angle * (j + 1)) for j, a in enumerate(ar))
            expected = mpmath.mpf(2) / 1000 / abs(response) ** 2
        found = lsf_spectrum(lsf, 1.0, np.array([frequency_hz]), RATE_HZ)[0]
        assert oracles.relative_error(found, expected) < 1e-11
    lost = ar_spectrum(lsf_to_ar(lsf), 1.0, np.array([20.0]), RATE_HZ)[0]
    kept = lsf_spectrum(lsf, 1.0, np.array([20.0]), RATE_HZ)[0]
    assert lost < 0.5 * kept


@pytest.mark.parametrize("frequency_hz", [-1.0, 500.1, np.nan])
def test_frequencies_beyond_half_the_rate_are_refused(frequency_hz):
    with pytest.raises(InputError, match="half the rate"):
        ar_spectrum(np.zeros(2), 1.0, np.array([frequency_hz]), RATE_HZ)
