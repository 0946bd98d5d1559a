"""What a Haptuator gets: band, voltage limit, interpolation, and two clocks."""

import math
from itertools import count, islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import signal

from mmt.devices.haptuator.card_buffer import CardBuffer
from mmt.devices.haptuator.driver import VoltageDrive
from mmt.devices.haptuator.equaliser import ActuatorLevel
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.devices.haptuator.resampling import AFTER, BEFORE, SampleRing, tap_table
from mmt.devices.protocols import ActuatorStatistics


def drive(**changes):
    return VoltageDrive(
        HaptuatorOptions(**{"volts_per_m_s2": 0.1, "full_scale_v": 6.0, **changes}), 1000.0
    )


def test_the_voltage_is_that_of_scipys_filters_scaled():
    samples = np.random.default_rng(1).normal(0.0, 5.0, 500)
    high = signal.butter(2, 90.0, "highpass", fs=1000.0, output="sos")
    low = signal.bessel(2, 300.0, norm="mag", fs=1000.0, output="sos")
    expected = 0.1 * signal.sosfilt(np.vstack([high, low]), samples)
    np.testing.assert_allclose(drive(high_hz=300.0).convert(samples), expected, atol=1e-12)
    wide = 0.1 * signal.sosfilt(high, samples)
    np.testing.assert_allclose(drive().convert(samples), wide, atol=1e-12)


@settings(max_examples=40)
@given(st.lists(st.integers(0, 40), max_size=20), st.integers(1, 32), st.sampled_from([1e3, 4e3]))
def test_an_equaliser_is_the_same_however_samples_come(counts, taps, rate_hz):
    """One by one, many at a time, or none; and with half the taps at twice the level."""
    random = np.random.default_rng(taps)
    level = ActuatorLevel(0.1, (1.0, *random.normal(0.0, 0.02, taps - 1).tolist()))
    options = HaptuatorOptions(volts_per_m_s2=0.1, full_scale_v=6.0, low_hz=20.0)
    other = ActuatorLevel(0.2, tuple(0.5 * tap for tap in level.taps))
    pieces, whole, halved = (VoltageDrive(options, rate_hz, each) for each in (level, level, other))
    samples = random.normal(0.0, 1.0, sum(counts))
    parts = np.split(samples, np.cumsum(counts)) if counts else []
    found = [volts for part in parts for volts in pieces.convert(part)]
    expected = whole.convert(samples)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(halved.convert(samples), expected, atol=1e-9)


@given(
    st.lists(st.floats(width=64), max_size=50),
    st.floats(0.01, 100.0),
    st.floats(0.1, 20.0),
    st.floats(0.1, 20.0),
)
def test_no_voltage_is_ever_beyond_the_limit(samples, volts_per_m_s2, limit_v, full_scale_v):
    volts = drive(volts_per_m_s2=volts_per_m_s2, limit_v=limit_v, full_scale_v=full_scale_v)
    played = volts.convert(samples)
    assert len(played) == len(samples)
    assert all(abs(value) <= min(limit_v, full_scale_v) for value in played)
    assert all(math.isfinite(value) for value in played)
    assert volts.statistics.samples == len(samples)


def test_what_is_cut_or_not_finite_is_counted():
    volts = drive()
    assert volts.statistics == ActuatorStatistics(0, 0, 0.0, 0.0)
    played = volts.convert([100.0, -100.0] * 50) + volts.convert([math.nan, math.inf])
    statistics = volts.statistics
    assert statistics.samples == 102
    assert max(played) == pytest.approx(3.0)
    assert statistics.clipped == sum(abs(value) == 3.0 for value in played) + 2
    assert statistics.peak_m_s2 == 100.0
    assert statistics.rms_m_s2 == pytest.approx(10.0 * np.sqrt(np.mean(np.square(played))))


def ring_of(samples):
    """One that holds as many samples, which have been written."""
    ring = SampleRing(len(samples).bit_length() - 1)
    ring.write(samples)
    return ring


def test_samples_are_met_and_a_constant_is_kept():
    samples = np.random.default_rng(2).normal(size=64)
    reader = ring_of(samples)
    np.testing.assert_allclose(reader.read(10.0, 1.0, 40), samples[10:50], atol=1e-12)
    np.testing.assert_allclose(tap_table().sum(axis=1), 1.0, atol=1e-12)
    reader.write(np.full(64, 2.5))
    np.testing.assert_allclose(reader.read(3.3, 0.021, 500), 2.5, atol=1e-12)


@pytest.mark.parametrize(
    ("frequency_hz", "within"), [(90.0, 0.03), (200.0, 0.03), (300.0, 0.04), (400.0, 0.30)]
)
def test_a_tone_in_the_band_keeps_its_level(frequency_hz, within):
    ring = np.sin(2.0 * np.pi * frequency_hz * np.arange(1024) / 1000.0)
    instants = 20.0 + np.arange(40_000) / 48.0
    played = ring_of(ring).read(20.0, 1.0 / 48.0, 40_000)
    wanted = np.sin(2.0 * np.pi * frequency_hz * instants / 1000.0)
    assert np.max(np.abs(played - wanted)) < within


@settings(max_examples=40)
@given(
    arrays(np.float64, 64, elements=st.floats(-1e6, 1e6)),
    st.floats(BEFORE, 50.0),
    st.floats(1e-3, 3.0),
    st.integers(0, 200),
)
def test_a_ring_is_read_around_its_end(ring, position, step, number):
    twice = np.concatenate([ring, ring, ring, ring])
    whole = 64 * (math.ceil((position + step * number + AFTER) / 64) + 1)
    if whole > len(twice):
        number = int((len(twice) - AFTER - 1 - position) / step)
    expected = ring_of(twice).read(position, step, number)
    np.testing.assert_allclose(
        ring_of(ring).read(position + 640.0, step, number), expected, atol=1e-3, rtol=1e-6
    )


def run(buffer, seconds, *, session_ppm=0.0, block=96):
    """Write and read in turn, as the two clocks demand."""
    tone = (math.sin(0.4 * math.pi * k) for k in count())
    due, played = 0.0, []
    for _ in range(round(seconds * 48_000 / block)):
        due += block / 48.0 * (1.0 + 1e-6 * session_ppm)
        buffer.write(list(islice(tone, int(due))))
        due -= int(due)
        played.append(buffer.read(block))
    return np.concatenate(played)


@pytest.fixture
def buffer():
    """One of a session of 1 kHz and a card of 48 kHz."""
    return CardBuffer(1000.0, 48_000.0, 96, 4.0)


@pytest.mark.parametrize("session_ppm", [-1000.0, 0.0, 300.0])
def test_a_drift_is_learnt_without_a_slip(buffer, session_ppm):
    played = run(buffer, 20.0, session_ppm=session_ppm)
    assert (buffer.underruns, buffer.slips) == (0, 0)
    assert abs(buffer.fill - buffer.target) < 1.5
    assert buffer.follower.drift == pytest.approx(1e-6 * session_ppm, abs=2e-4)
    # no jump anywhere: a tone's steps are bounded
    assert np.max(np.abs(np.diff(played))) < 1.1 * 2.0 * np.pi * 200.0 / 48_000.0


def test_a_drift_beyond_what_can_be_followed_slips_and_goes_on(buffer):
    played = run(buffer, 20.0, session_ppm=20_000.0)
    assert buffer.slips >= 3
    assert buffer.underruns == 0
    assert np.max(np.abs(np.diff(played))) < 0.1
    assert np.sqrt(np.mean(played[-48_000:] ** 2)) > 0.6


def test_late_samples_make_one_underrun_that_fades_and_ends(buffer):
    run(buffer, 0.5)
    starved = np.concatenate([buffer.read(96) for _ in range(20)])
    assert buffer.underruns == 1
    assert buffer.silent
    assert np.max(np.abs(np.diff(starved))) < 0.1
    assert np.all(starved[-960:] == 0.0)
    played = run(buffer, 0.5)
    assert buffer.underruns == 1
    assert np.sqrt(np.mean(played[-9600:] ** 2)) == pytest.approx(math.sqrt(0.5), rel=0.02)


def test_a_clump_of_samples_is_no_loss_of_the_card_and_does_not_block(buffer):
    run(buffer, 0.2)
    buffer.write([0.5] * 20_000)
    played = np.concatenate([buffer.read(96) for _ in range(10)])
    assert buffer.slips == 1
    assert np.all(np.isfinite(played))
    assert np.max(np.abs(np.diff(played))) < 0.15


def test_muting_fades_to_silence(buffer):
    before = run(buffer, 0.2)
    buffer.mute()
    after = np.concatenate([before[-1:], *(buffer.read(96) for _ in range(3))])
    assert buffer.silent
    assert np.max(np.abs(np.diff(after))) < 0.03
    buffer.write([1.0] * 100)
    assert not buffer.read(96).any()


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.integers(0, 60), st.integers(1, 2000)), max_size=60),
    st.floats(1.0, 50.0),
    st.sampled_from([8000.0, 44_100.0, 192_000.0]),
)
def test_whatever_comes_when_frames_are_whole_finite_and_bounded(turns, buffer_ms, card_rate_hz):
    buffer = CardBuffer(1000.0, card_rate_hz, 96, buffer_ms)
    for samples, frames in turns:
        buffer.write([1.0] * samples)
        block = buffer.read(frames)
        assert block.shape == (frames,)
        assert np.all(np.abs(block) <= 1.5)
