"""Gaps that are bridged: what they are filled with, and that they count for nothing."""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_samples import stroke_frames

from mmt.texture.autoregression.burg import burg
from mmt.texture.autoregression.forms import reflection_to_ar
from mmt.texture.field.blocks import mean_square
from mmt.texture.settings import LONGEST_BRIDGED, ModellingSettings
from mmt.texture.signals.bridging import HISTORY, ORDER, fill
from mmt.texture.signals.filtering import StreamFilter

AR = np.poly(np.array([0.97, 0.97, 0.93, 0.93, 0.8]) * np.exp([0.9j, -0.9j, 1.9j, -1.9j, 0.0]))


def noise(count, seed, taps=AR):
    generator = np.random.default_rng(seed)
    excitation = generator.standard_normal(count + 500)
    return scipy.signal.lfilter([1.0], np.real(taps), excitation)[500:]


def lost(count, share, seed, longest=LONGEST_BRIDGED):
    """Return which frames are lost at random, none of the first 200, in short runs."""
    gone = np.random.default_rng(seed).random(count) < share
    gone[:200] = gone[-20:] = False
    run = 0
    for i in range(count):
        run = run + 1 if gone[i] else 0
        if run > longest:
            gone[i], run = False, 0
    return gone


@pytest.mark.parametrize("seed", range(5))
def test_the_fill_has_the_least_errors_of_prediction(seed):
    generator = np.random.default_rng(seed)
    start, stop = 300, 300 + int(generator.integers(1, 6))
    newest = stop + 8
    x = noise(newest + 1, seed)
    unknown = np.zeros(len(x), np.bool_)
    unknown[start:stop] = True
    unknown[stop + 2 : stop + 2 + seed % 3] = True
    filled = x[:, None].copy()
    filled[unknown] = 1e3
    fill(filled, unknown, start, stop, start, newest, 1)

    past = x[start - HISTORY : start]
    taps = np.r_[1.0, reflection_to_ar(burg(past - past.mean(), ORDER).reflection)]
    rows = np.zeros((newest + 1 - start, len(x)))
    for row in range(len(rows)):
        at = start + row
        rows[row, at - ORDER : at + 1] = taps[::-1]
    known = np.where(unknown, 0.0, x - past.mean())
    solution = np.linalg.lstsq(rows[:, unknown], -rows @ known, rcond=None)[0]
    expected = past.mean() + solution[: stop - start]
    np.testing.assert_allclose(filled[start:stop, 0], expected, rtol=1e-9, atol=1e-9)
    assert np.array_equal(filled[stop:][~unknown[stop:], 0], x[stop:][~unknown[stop:]])


@pytest.mark.parametrize("value", [0.0, 9.81, -1e6])
@pytest.mark.parametrize("history", [1, 40, 300])
def test_a_constant_is_filled_with_itself(value, history):
    filled = np.full((330, 3), value)
    unknown = np.zeros(330, np.bool_)
    unknown[300:305] = True
    filled[unknown] = np.nan
    fill(filled, unknown, 300, 305, history, 312, 1)
    np.testing.assert_allclose(filled, value)


@given(seed=st.integers(0, 1000), share=st.sampled_from([0.005, 0.05, 0.3, 0.7]))
@settings(max_examples=40)
def test_short_gaps_leave_no_gap_whatever_their_pattern(seed, share):
    frames = stroke_frames(noise(700, seed))
    gone = lost(len(frames), share, seed)
    stream = StreamFilter()
    aligned = stream.process(frames[~gone])
    whole = StreamFilter().process(frames)
    np.testing.assert_array_equal(aligned.index, whole.index)
    np.testing.assert_array_equal(aligned.valid, whole.valid)
    np.testing.assert_array_equal(aligned.measured, ~gone[: len(aligned)])
    np.testing.assert_array_equal(aligned.time_ns, whole.time_ns)
    np.testing.assert_allclose(aligned.speed_mm_s[100:], 100.0, rtol=1e-3)
    assert stream.faults.missing_s == stream.faults.bridged_s == np.count_nonzero(gone) / 1000


def test_a_longer_gap_is_not_bridged_and_none_is_where_it_is_turned_off():
    frames = stroke_frames(noise(600, 1))
    for longest, gap in ((5, 6), (0, 1), (2, 3)):
        stream = StreamFilter(ModellingSettings(longest_bridged_samples=longest))
        aligned = stream.process(np.delete(frames, np.s_[300 : 300 + gap]))
        assert not set(range(300, 300 + gap)) & set(aligned.index.tolist())
        assert stream.faults.bridged_s == 0
        assert stream.faults.missing_s == gap / 1000


def test_filled_samples_count_for_no_power():
    vibration = np.full((1, 50, 1), 2.0)
    measured = np.ones((1, 50), np.bool_)
    vibration[0, 10:15], measured[0, 10:15] = 100.0, False
    assert mean_square(vibration, measured) == pytest.approx(4.0)
    assert np.isnan(mean_square(vibration, np.zeros_like(measured)))
