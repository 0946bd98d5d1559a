import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.texture.signals.aligned import dft321


@given(count=st.integers(1, 400), seed=st.integers(0, 100), exponent=st.integers(-100, 100))
@settings(max_examples=60)
def test_keeps_energy_in_every_bin(count, seed, exponent):
    axes = np.random.default_rng(seed).normal(size=(count, 3)) * 10.0**exponent
    reduced = dft321(axes)
    assert reduced.shape == (count,)
    np.testing.assert_allclose((reduced**2).sum(), (axes**2).sum(), rtol=1e-12)
    power = (np.abs(np.fft.rfft(axes, axis=0)) ** 2).sum(axis=1)
    np.testing.assert_allclose(
        np.abs(np.fft.rfft(reduced)) ** 2, power, rtol=1e-9, atol=1e-12 * power.max()
    )


def test_takes_the_phase_of_the_sum():
    axes = np.random.default_rng(1).normal(size=(256, 3))
    expected = np.angle(np.fft.rfft(axes.sum(axis=1))[1:-1])
    difference = np.angle(np.fft.rfft(dft321(axes))[1:-1]) - expected
    np.testing.assert_allclose(np.exp(1j * difference), 1.0, atol=1e-9)


def test_one_axis_alone_passes_unchanged():
    signal = np.random.default_rng(2).normal(size=301)
    for axis in range(3):
        axes = np.zeros((301, 3))
        axes[:, axis] = signal
        np.testing.assert_allclose(dft321(axes), signal, atol=1e-12)


def test_axes_that_cancel_keep_their_energy():
    signal = np.sin(2.0 * np.pi * 0.1 * np.arange(200))
    reduced = dft321(np.stack([signal, -signal, np.zeros(200)], axis=1))
    assert (reduced**2).sum() == pytest.approx(2.0 * (signal**2).sum(), rel=1e-9)


def test_nothing_and_silence():
    assert dft321(np.zeros((0, 3))).shape == (0,)
    np.testing.assert_array_equal(dft321(np.zeros((50, 3))), 0.0)
