import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.signal import lfilter

from mmt.core.errors import InputError
from mmt.texture.autoregression.burg import burg
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt.texture.signals.metrics import amplitude_spectra, power_error_db
from mmt.texture.synthesis.concealment import continuation

finite = st.floats(-1e300, 1e300)
pasts = st.integers(48, 200).flatmap(
    lambda count: hnp.arrays(
        np.float64, count, elements=st.one_of(finite, st.floats(-2, 2), st.just(0.0))
    )
)


def noise(count, seed=0):
    return np.random.default_rng(seed).standard_normal(count)


def textured(samples, seed):
    """Two resonances over broad-band noise."""
    poles = [0.95 * np.exp(0.5j), 0.9 * np.exp(1.4j)]
    ar = np.poly([*poles, *np.conj(poles)]).real
    signal = lfilter([1.0], ar, noise(samples + 1000, seed))[1000:]
    return signal / np.std(signal) + 0.3 * noise(samples, seed + 1)


EXTREMES = {
    "constant": np.full(128, 3.0),
    "tone": np.sin(0.3 * np.arange(128)),
    "ramp": np.arange(128.0),
    "impulse now": np.eye(1, 128, 127).ravel(),
    "impulse before": np.eye(1, 128, 0).ravel(),
    "denormal": 5e-324 * np.ones(128),
}


@given(
    past=pasts | st.sampled_from(sorted(EXTREMES)).map(EXTREMES.get),
    seed=st.integers(0, 99),
    fade=st.integers(1, 60),
)
@settings(max_examples=200)
def test_any_past_is_continued_without_a_click_bounded_and_into_silence(past, seed, fade):
    gain = np.concatenate([np.linspace(1, 0, 60 + fade)[:-1], np.zeros(20)])
    output = continuation(past, gain, noise(len(gain), seed))
    peak = np.abs(past).max()
    steepest = max(np.abs(np.diff(past / 4)).max() * 4, peak / 16)
    assert np.isfinite(output).all()
    assert np.abs(output).max() <= peak
    steps = np.diff(np.concatenate([past[-1:], output]) / 4) * 4
    assert np.abs(steps).max() <= steepest * (1 + 1e-12)
    assert output[-1] == 0.0


@pytest.mark.parametrize("order", [1, 5, 12])
def test_without_noise_it_is_the_linear_prediction(order):
    past = textured(128, 3)
    ar = reflection_to_ar(burg(past, order).reflection)
    expected = list(past)
    for _ in range(10):
        expected.append(-np.dot(ar, expected[: -order - 1 : -1]))
    output = continuation(past, np.ones(10), np.zeros(10), order)
    np.testing.assert_allclose(output, expected[128:], atol=1e-11)


def test_the_first_sample_is_the_prediction_and_an_error_of_the_newest_errors_level():
    past = textured(200, 4)
    predicted = continuation(past, np.ones(1), np.zeros(1))[0]
    ar = np.concatenate([[1.0], reflection_to_ar(burg(past, 16).reflection)])
    level = np.sqrt(np.mean(lfilter(ar, 1.0, past)[-32:] ** 2))
    one = continuation(past, np.ones(1), np.full(1, 0.1))[0]
    assert one - predicted == pytest.approx(0.1 * level, rel=1e-9)


def test_its_spectrum_and_level_are_those_of_the_signal():
    pasts = [textured(128, seed) for seed in range(300)]
    ones = np.ones(128)
    continued = np.array([continuation(p, ones, noise(128, i)) for i, p in enumerate(pasts)])
    own, theirs = (amplitude_spectra(rows, 1000.0, 32)[1] ** 2 for rows in (continued, pasts))
    error_db = power_error_db(own.mean(axis=0), theirs.mean(axis=0))[1:]
    assert np.sqrt(np.mean(error_db**2)) < 0.7
    level_db = power_error_db(np.mean(continued**2), np.mean(np.square(pasts)))
    assert abs(level_db) < 0.4


@pytest.mark.parametrize("scale", [1e-300, 1.0, 2.0**900])
def test_it_scales_with_the_signal(scale):
    past = textured(128, 5)
    reference = continuation(past, np.ones(100), noise(100))
    scaled = continuation(past * scale, np.ones(100), noise(100))
    np.testing.assert_allclose(scaled / scale, reference, rtol=1e-9)


def test_a_level_that_has_just_fallen_is_kept():
    past = np.concatenate([textured(90, 6), 0.05 * textured(38, 7)])
    output = continuation(past, np.ones(100), noise(100))
    assert np.std(output) < 0.2


@pytest.mark.parametrize(
    ("past", "gain", "excitation", "order", "message"),
    [
        (np.ones(43), np.ones(5), np.zeros(5), 12, "at least 44"),
        (np.ones(64), np.ones(5), np.zeros(4), 12, "one row each"),
        (np.ones(64), np.ones(5), np.zeros(5), 0, "order is 0, allowed is"),
        (np.r_[np.ones(60), np.nan, 1, 1, 1], np.ones(5), np.zeros(5), 12, "not finite"),
        (np.ones(64), np.full(5, np.inf), np.zeros(5), 12, "not finite"),
        (np.ones(64), np.ones(5), np.full(5, np.nan), 12, "not finite"),
    ],
)
def test_what_cannot_be_continued_is_explained(past, gain, excitation, order, message):
    with pytest.raises(InputError, match=message):
        continuation(past, gain, excitation, order)
