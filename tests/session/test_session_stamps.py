"""Rows of a clock whose stamps jitter are put at its times; other stamps are left alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.session.files import import_session
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
    assert assess_stamps(stamps_s).regular


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
    assert np.percentile(np.abs(off_s - np.median(off_s)), 99.9) < 1e-4


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


@pytest.mark.parametrize("noise_mm", [0.0, 0.02, 0.05])
def test_noise_in_the_motion_does_not_make_a_clock_better(noise_mm):
    rng = np.random.default_rng(7)
    truth_s = np.arange(5000) / 500 + 4e-4 * rng.uniform(-1, 1, 5000)
    rows = motion(truth_s) + noise_mm * rng.standard_normal((5000, 3))
    assert not assess_stamps(truth_s, rows).regular


@pytest.mark.parametrize("choice", ["auto", "header", "receipt", "regular", "kept"])
def test_a_clock_has_its_period_its_jitter_and_its_missing_rows(choice):
    truth_s = np.delete(np.arange(800) / 100, [100, 400, 401])
    late_s = np.resize([0.002, 0.0, -0.002], 797)
    stamps_s = truth_s + np.random.default_rng(1).permutation(late_s)
    found = assess_stamps(stamps_s, choice=choice)
    assert (found.periodic, found.regular) == (True, choice != "kept")
    np.testing.assert_allclose(found.time_s, truth_s if found.regular else stamps_s, atol=1e-4)
    assert found.period_s == pytest.approx(0.01, rel=1e-4)
    assert found.jitter_s == pytest.approx(0.002 * np.sqrt(2 / 3), rel=1e-3)
    assert found.largest_s == pytest.approx(0.002, rel=1e-2)
    assert found.missing_rows == 3


@pytest.mark.parametrize(
    ("stamps_s", "period_s", "jitter_s", "largest_s", "missing"),
    [
        ([0, 1, 2, 4, 5, 6], 1, 0, 0, 1),
        ([0, 1.1, 2, 3, 5.1, 6], 1, np.sqrt(0.04 / 5), 0.1, 1),
        ([0, 1, 2.5, 3, 4.75, 5], 1, np.sqrt(0.325), 0.75, 0),
        ([0, 0, 0, 1, 1, 1, 2, 2, 2], 0.25, np.sqrt(0.1875), 0.75, 0),
        ([3, 3, 3], 0, 0, 0, 0),
        (np.arange(15), 1, 0, 0, 0),
    ],
)
def test_few_stamps_are_kept_and_described(stamps_s, period_s, jitter_s, largest_s, missing):
    stamps_s = np.array(stamps_s, dtype=float)
    found = assess_stamps(stamps_s, choice="regular")
    np.testing.assert_array_equal(found.time_s, stamps_s)
    figures = (found.period_s, found.jitter_s, found.largest_s)
    assert figures == pytest.approx((period_s, jitter_s, largest_s))
    assert (found.missing_rows, found.periodic, found.regular) == (missing, False, False)


def test_sixteen_rows_are_enough_for_a_clock_and_equal_stamps_are_none():
    found = assess_stamps(np.arange(16.0))
    assert (found.periodic, found.period_s, found.missing_rows) == (True, 1.0, 0)
    assert not assess_stamps(np.full(300, 7.0), choice="regular").periodic


def in_stretches(lengths, pauses, rate_hz):
    """Return times of rows of a clock, that begins anew after pauses, in periods."""
    steps = np.ones(sum(lengths))
    steps[np.cumsum(lengths)[:-1]] = pauses
    return np.cumsum(steps) / rate_hz


@pytest.mark.parametrize(
    ("lengths", "pauses", "rate_hz"),
    [
        ([400, 400], [40.4], 100),
        ([400, 400], [105.4], 1000),
        ([100, 90, 80, 70], [60.4, 70.6, 55.3], 500),
        ([300, 20, 500, 1], [90.4, 120.6, 77.3], 100),
    ],
)
def test_a_line_begins_anew_after_each_pause(lengths, pauses, rate_hz):
    truth_s = in_stretches(lengths, pauses, rate_hz)
    stamps_s = truth_s + np.random.default_rng(1).uniform(-0.1, 0.1, len(truth_s)) / rate_hz
    found = assess_stamps(stamps_s, choice="regular")
    assert found.regular
    assert found.period_s == pytest.approx(1 / rate_hz, rel=1e-3)
    assert found.missing_rows == sum(round(pause) - 1 for pause in pauses)
    assert off_ms(found.time_s, truth_s) < 150 / rate_hz


def test_a_line_that_begins_before_the_last_ended_is_moved():
    """A clock of 100 Hz that is set back by 6 ms."""
    stamps_s = np.arange(16_384) / 100 - 0.006 * (np.arange(16_384) >= 8192)
    found = assess_stamps(stamps_s, choice="regular")
    assert found.regular
    steps_s = np.diff(found.time_s)
    assert (steps_s[8191], *np.delete(steps_s, 8191)[[0, -1]]) == pytest.approx((0.005, 0.01, 0.01))


@pytest.mark.parametrize(("clockless", "periodic"), [(1, True), (4, False)])
def test_a_clock_is_that_of_nine_rows_in_ten(clockless, periodic):
    rng = np.random.default_rng(2)
    steps = np.ones((20, 300))
    steps[:clockless] = np.linspace(0.5, 1.4, 300)
    steps[:, 0] = 100.0
    stamps_s = np.cumsum(steps) / 100 + 1e-3 * rng.uniform(-1, 1, 6000)
    assert assess_stamps(np.sort(stamps_s), choice="regular").periodic == periodic


def test_batches_at_other_times_than_a_clocks_need_a_motion_that_tells_it():
    truth_s = np.arange(4000) / 100
    late_s = np.random.default_rng(3).uniform(0.0, 0.3, 500)
    stamps_s = np.repeat(np.sort(truth_s[7::8] + late_s), 8)
    assert not assess_stamps(stamps_s).periodic
    assert not assess_stamps(stamps_s, motion(stamps_s)).regular
    found = assess_stamps(stamps_s, motion(truth_s))
    assert (found.periodic, found.regular) == (True, True)
    assert off_ms(found.time_s, truth_s) < 10


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
@settings(max_examples=60)
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
@settings(max_examples=60)
def test_any_stamps_give_times_that_are_finite_and_in_order(rows, scale, start_s, seed):
    rng = np.random.default_rng(seed)
    stamps_s = start_s + np.cumsum(scale * rng.pareto(1.5, rows) * rng.integers(0, 2, rows))
    found = assess_stamps(stamps_s)
    assert np.isfinite(found.time_s).all()
    assert len(found.time_s) == rows
    assert np.all(np.diff(found.time_s) >= 0)


@pytest.mark.parametrize("channel", ["position_mm", "force_n"])
def test_nothing_overshoots_between_uneven_stamps(tmp_path, channel):
    rng = np.random.default_rng(10)
    time_s = np.cumsum(rng.exponential(2e-3, 3000) + 1e-5)
    values = np.column_stack([np.sign(np.sin(9 * time_s)), time_s, 0 * time_s])
    np.savez(tmp_path / "a.npz", time_s=time_s, **{channel: values})
    imported = import_session(tmp_path / "a.npz", longest_gap_s=1.0).frames[channel]
    assert np.abs(imported[:, 0]).max() <= 1.0
    assert np.all(np.diff(imported[:, 1]) >= 0)
