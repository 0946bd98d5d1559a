"""Rows of a clock whose stamps jitter are put at its times; other stamps are left alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.session import import_session
from mmt.session.importing.stamps import assess_stamps


def motion(time_s):
    """A stroking hand, measured to 2 um; shape (n, 3)."""
    noise = 0.002 * np.random.default_rng(5).standard_normal((len(time_s), 3))
    clean = [40 * np.sin(2 * np.pi * 0.7 * time_s), 2 * time_s, 0 * time_s]
    return np.column_stack(clean) + noise


def off_ms(time_s, truth_s):
    """What times lie off the truth (ms), apart from one delay of all."""
    off = time_s - truth_s
    return 1e3 * np.abs(off - np.median(off)).max()


@pytest.mark.parametrize("jitter_ms", [0.02, 0.3, 0.6, 1.5])
def test_jitter_is_taken_off_a_clock(jitter_ms):
    truth_s = np.arange(10_000) / 500
    rng = np.random.default_rng(1)
    stamps_s = np.maximum.accumulate(truth_s + 1e-3 * jitter_ms * rng.standard_normal(10_000))
    found = assess_stamps(stamps_s, motion(truth_s))
    assert found.regular
    assert found.period_s == pytest.approx(0.002, rel=1e-4)
    assert found.missing_rows == 0
    assert off_ms(found.time_s, truth_s) < 0.1 * jitter_ms + 0.05


@pytest.mark.parametrize("rows", [2, 8, 32, 100])
def test_batches_are_spread_over_their_time(rows):
    truth_s = np.arange(20_000) / 1000
    stamps_s = truth_s[(np.arange(20_000) // rows * rows + rows - 1).clip(max=19_999)]
    found = assess_stamps(stamps_s, motion(truth_s))
    assert found.regular
    assert off_ms(found.time_s, truth_s) < 0.01 * rows


def test_late_stamps_do_not_tilt_the_line():
    truth_s = np.arange(5000) / 500
    late = np.random.default_rng(2).random(5000) < 0.02
    stamps_s = np.maximum.accumulate(truth_s + 0.02 * late)
    found = assess_stamps(stamps_s, motion(truth_s))
    assert found.regular
    assert off_ms(found.time_s, truth_s) < 0.05


def test_missing_rows_are_counted_where_they_are_missing():
    rng = np.random.default_rng(3)
    there = np.ones(60_000, dtype=bool)
    there[rng.choice(np.arange(100, 59_900), 60, replace=False)] = False
    truth_s = np.arange(60_000)[there] / 1000
    stamps_s = np.maximum.accumulate(truth_s + 2e-4 * rng.standard_normal(len(truth_s)))
    found = assess_stamps(stamps_s, motion(truth_s))
    assert found.regular
    assert found.missing_rows == pytest.approx(60, abs=2)
    off_s = found.time_s - truth_s
    assert np.percentile(np.abs(off_s - np.median(off_s)), 95) < 1e-4


def test_a_pause_begins_the_line_anew():
    truth_s = np.arange(4000) / 500
    truth_s[2000:] += 3.0013
    stamps_s = truth_s + 3e-4 * np.random.default_rng(4).uniform(-1, 1, 4000)
    found = assess_stamps(stamps_s, motion(truth_s))
    assert found.regular
    assert found.missing_rows == pytest.approx(1500, abs=1)
    assert off_ms(found.time_s, truth_s) < 0.1


def test_a_clock_that_runs_fast_is_followed():
    truth_s = np.arange(100_000) / 1000 * (1 + 2e-4) + 1e-3 * np.sin(np.arange(100_000) / 3e4)
    stamps_s = truth_s + 2e-4 * np.random.default_rng(6).uniform(-1, 1, 100_000)
    found = assess_stamps(stamps_s, motion(truth_s))
    assert found.regular
    assert off_ms(found.time_s, truth_s) < 0.2


def test_rows_that_were_sampled_when_their_stamps_say_so_keep_them():
    """A program that samples when it is scheduled: the motion tells, the stamps alone cannot."""
    truth_s = np.arange(5000) / 500 + 4e-4 * np.random.default_rng(7).uniform(-1, 1, 5000)
    found = assess_stamps(truth_s, motion(truth_s))
    assert found.periodic
    assert not found.regular
    np.testing.assert_array_equal(found.time_s, truth_s)
    assert assess_stamps(truth_s, motion(truth_s), "regular").regular


def test_intervals_without_a_clock_are_kept():
    rng = np.random.default_rng(8)
    truth_s = np.cumsum(rng.uniform(0.5e-3, 3.5e-3, 5000))
    found = assess_stamps(truth_s, motion(truth_s), "regular")
    assert not found.periodic
    np.testing.assert_array_equal(found.time_s, truth_s)


@given(
    share=st.floats(0, 0.05),
    clocked=st.booleans(),
    noise=st.floats(0, 100),
    longest_burst=st.integers(6, 60),
    longest_hole=st.integers(1, 14),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_bursts_with_holes_are_where_their_stamps_are(
    share, clocked, noise, longest_burst, longest_hole, seed
):
    """Rows that were lost on the way, of a clock or of none: noise in them decides nothing."""
    rng = np.random.default_rng(seed)
    bursts, holes = (rng.integers(1, top + 1, 400) for top in (longest_burst, longest_hole))
    steps = np.ones(1500)
    ends = np.cumsum(4 + bursts)
    ends = ends[ends < 1500]
    steps[ends] += holes[: len(ends)] if clocked else 1.37 * holes[: len(ends)]
    truth_s = np.cumsum(steps) / 150
    if not clocked:
        truth_s = np.cumsum(steps / 150 * (1 + share * rng.standard_normal(1500)))
    stamps_s = truth_s + clocked * share / 150 * rng.uniform(-1, 1, 1500)
    rows = motion(truth_s) + noise * rng.standard_normal((1500, 3))
    found = assess_stamps(stamps_s, rows)
    assert off_ms(found.time_s, truth_s) < 2.5e3 * share / 150 + 0.05


@given(
    rows=st.integers(2, 400),
    scale=st.floats(1e-6, 1e3),
    start_s=st.floats(-1e6, 1e6),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_any_stamps_give_times_that_are_finite_and_in_order(rows, scale, start_s, seed):
    rng = np.random.default_rng(seed)
    stamps_s = start_s + np.cumsum(scale * rng.pareto(1.5, rows) * rng.integers(0, 2, rows))
    found = assess_stamps(stamps_s)
    assert np.isfinite(found.time_s).all()
    assert len(found.time_s) == rows
    assert np.all(np.diff(found.time_s) >= 0)


def test_a_motion_under_jitter_keeps_its_speed(tmp_path):
    """500 Hz with 0.6 ms of jitter: along the stamps the hand would race at metres a second."""
    truth_s = np.arange(5000) / 500
    jitter_s = 6e-4 * np.random.default_rng(9).standard_normal(5000)
    stamps_s = np.maximum.accumulate(truth_s + jitter_s)
    position_mm = motion(truth_s)
    np.savez(tmp_path / "a.npz", time_s=stamps_s, position_mm=position_mm)
    frames = import_session(tmp_path / "a.npz").frames
    speed_mm_s = 1e3 * np.abs(np.diff(frames["position_mm"][:, 0].astype(float)))
    assert speed_mm_s.max() < 200  # 176 are the hand's own
    at_frames = np.interp(frames["time_ns"] / 1e9, truth_s, position_mm[:, 0])
    assert np.abs(frames["position_mm"][:, 0] - at_frames).max() < 0.1


@pytest.mark.parametrize("channel", ["position_mm", "force_n"])
def test_nothing_overshoots_between_uneven_stamps(tmp_path, channel):
    rng = np.random.default_rng(10)
    time_s = np.cumsum(rng.exponential(2e-3, 3000) + 1e-5)
    values = np.column_stack([np.sign(np.sin(9 * time_s)), time_s, 0 * time_s])
    np.savez(tmp_path / "a.npz", time_s=time_s, **{channel: values})
    imported = import_session(tmp_path / "a.npz", longest_gap_s=1.0).frames[channel]
    assert np.abs(imported[:, 0]).max() <= 1.0
    assert np.all(np.diff(imported[:, 1]) >= 0)
