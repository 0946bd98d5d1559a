"""What a high-pass takes from slow lines: against SciPy's filters and known spectra."""

import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter, sosfilt

from mmt.texture.segmentation.low_band import LEAST_AIR_WINDOWS, LOW_CUTOFF_HZ, LowBand, lowering
from mmt.texture.segmentation.segments import SampleRange, Segment
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.dft321 import dft321
from mmt.texture.signals.noise_floor import WINDOW

RATE_HZ = 1000.0
AIR = (LEAST_AIR_WINDOWS + 5) * WINDOW


def high_passed(signal, cutoff_hz):
    sections = butter(2, cutoff_hz, "highpass", fs=RATE_HZ, output="sos")
    return sosfilt(sections, signal, axis=0)


def block(vibration, in_air, first=0):
    """A block of vibration (n, axes) whose first samples are in the air."""
    count = len(vibration)
    index = np.arange(first, first + count)
    return AlignedBlock(
        index=index,
        time_ns=index,
        position_mm=np.zeros((count, 3)),
        velocity_mm_s=np.zeros((count, 2)),
        speed_mm_s=np.full(count, 100.0),
        normal_force_n=np.where(np.arange(count) < in_air, 0.0, 1.0),
        vibration_m_s2=vibration,
        valid=np.ones(count, np.bool_),
    )


def segment_of(part, start, stop):
    inside = part[start - int(part.index[0]) : stop - int(part.index[0])]
    return Segment.from_block(inside, SampleRange(start, stop), final=True)


def line(frequency_hz, width_hz, count, seed=0):
    """A resonance, and its exact density at frequencies, driven by white noise."""
    radius, turn = np.exp(-np.pi * width_hz / RATE_HZ), 2.0 * np.pi * frequency_hz / RATE_HZ
    denominator = [1.0, -2.0 * radius * np.cos(turn), radius**2]
    signal = lfilter([1.0], denominator, np.random.default_rng(seed).normal(size=count + 3000))

    def density(cutoff_hz):
        bins = (np.arange(20_000) + 0.5) * 0.5 * RATE_HZ / 20_000
        response = freqz([1.0], denominator, worN=bins, fs=RATE_HZ)[1]
        if cutoff_hz is not None:
            response *= freqz(*butter(2, cutoff_hz, "highpass", fs=RATE_HZ), bins, fs=RATE_HZ)[1]
        return np.mean(np.abs(response) ** 2)

    return signal[3000:, None], density


def heard(vibration, air=None):
    """A stream of a second and more in the air and then the vibration, and its low band."""
    if air is None:
        air = 1e-4 * np.random.default_rng(9).normal(size=(AIR, vibration.shape[1]))
    part = block(np.vstack([air, vibration]), AIR)
    low = LowBand(RATE_HZ)
    for start in range(0, len(part), 1000):
        low.update(part[start : start + 1000])
    return part, low


def test_both_filters_in_turn_are_the_high_pass_of_the_lower_corner():
    signal = np.random.default_rng(1).normal(size=(3000, 3)) + 9.81
    signal -= signal[0]  # as a filter that starts in its steady state
    section = lowering(RATE_HZ)
    numerator, denominator = [section.b0, section.b1, section.b2], [1.0, section.a1, section.a2]
    found = lfilter(numerator, denominator, high_passed(signal, 10.0), axis=0)
    np.testing.assert_allclose(found, high_passed(signal, LOW_CUTOFF_HZ), atol=1e-11)
    assert np.abs(np.roots(denominator)).max() < 1.0
    assert section.gain_at_zero == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize("frequency_hz", [6.0, 9.0, 14.0])
def test_a_slow_line_gets_back_the_power_that_its_spectrum_says(frequency_hz):
    texture, power = line(frequency_hz, 3.5, 9000)
    part, low = heard(high_passed(texture, 10.0))
    found = low.restored(segment_of(part, AIR + 500, AIR + 9000))
    measured = np.mean(np.square(found.vibration_m_s2)) / np.mean(
        np.square(segment_of(part, AIR + 500, AIR + 9000).vibration_m_s2)
    )
    assert measured == pytest.approx(power(LOW_CUTOFF_HZ) / power(10.0), rel=0.05)
    lost, left = 1.0 - power(10.0) / power(None), 1.0 - power(LOW_CUTOFF_HZ) / power(None)
    assert left < 0.85 * lost


def test_the_segment_is_the_one_of_the_filter_with_the_lower_corner():
    texture = line(8.0, 3.0, 3000)[0] * [1.0, 0.5, 0.2]
    part, low = heard(high_passed(texture, 10.0))
    found = low.restored(segment_of(part, AIR + 1000, AIR + 1400))
    lower = high_passed(texture, LOW_CUTOFF_HZ)[1000:1400]
    np.testing.assert_allclose(found.vibration_m_s2, dft321(lower), atol=1e-3)
    assert (found.start, found.force_n) == (AIR + 1000, 1.0)


def test_what_the_hand_moves_as_much_in_the_air_is_not_given_back():
    hand = 3.0 * high_passed(line(8.0, 3.0, AIR, seed=1)[0], 10.0)
    part, low = heard(high_passed(line(8.0, 3.0, 3000)[0], 10.0), hand)
    alone = segment_of(part, AIR + 1000, AIR + 1400)
    assert low.restored(alone) is alone


def test_without_a_second_in_the_air_nothing_is_given_back():
    texture = high_passed(line(8.0, 3.0, 3000)[0], 10.0)
    part = block(texture, (LEAST_AIR_WINDOWS - 1) * WINDOW)
    low = LowBand(RATE_HZ)
    alone = segment_of(part, 2000, 2400)
    assert low.restored(alone) is alone
    low.update(part[:0])
    low.update(part)
    assert low.hand_power == np.inf
    assert low.restored(alone) is alone


def test_a_segment_that_is_no_longer_there_or_has_a_gap_stays_as_it_is():
    part, low = heard(high_passed(line(8.0, 3.0, 3000)[0], 10.0))
    alone = segment_of(part, AIR + 1000, AIR + 1400)
    assert low.restored(alone) is not alone
    for number in range(2):
        low.update(block(np.zeros((12_000, 1)), 0, first=int(part.index[-1]) + 1 + 12_000 * number))
    assert low.restored(alone) is alone
    _, low = heard(high_passed(line(8.0, 3.0, 500)[0], 10.0))
    low.update(block(part.vibration_m_s2[:900], 0, first=AIR + 501))
    assert low.restored(alone) is alone


def test_behind_a_gap_it_is_as_if_nothing_had_been_before():
    texture = high_passed(line(8.0, 3.0, 2000)[0], 10.0)
    part, low = heard(texture)
    late = block(texture, 0, first=50_000)
    low.update(late)
    after = low.restored(segment_of(late, 50_100, 50_600))
    again = LowBand(RATE_HZ)
    again.update(part[:AIR])
    again.update(late)
    expected = again.restored(segment_of(late, 50_100, 50_600))
    np.testing.assert_array_equal(after.vibration_m_s2, expected.vibration_m_s2)
