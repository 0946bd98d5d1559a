"""Times that wrap or begin anew, and rows written late or twice, are put right or left alone."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.importing.samples import Samples, continued, order_of, unfilled_rows

N = np.arange(400)
TIME_S = 7.0 + N / 1000
FORCE_N = np.column_stack([np.sin(N), np.cos(N), N])
WRAPS = "wraps, and was continued"
ANEW = (
    "begins anew, which was put 1 s after what was before; --episode 1 takes the first part, "
    "2 the next"
)


def moved(first, second, third):
    """Return rows with those from `first` to `second` written behind those to `third`."""
    return np.r_[0:first, second:third, first:second, third : len(N)]


@given(
    cuts=st.lists(st.integers(0, len(N)), min_size=3, max_size=3, unique=True).map(sorted),
    twice=st.booleans(),
    jitter=st.floats(0.0, 0.2),
)
def test_rows_written_late_or_twice_have_an_order(cuts, twice, jitter):
    first, second, third = cuts
    assume(third > second + 1 if twice else first > 0 or third < len(N))
    rows = np.r_[0:third, second : len(N)] if twice else moved(*cuts)
    time_s = TIME_S + jitter * np.random.default_rng(1).uniform(-1e-3, 1e-3, len(N))
    force_n = np.where(N[:, None] == 50, np.nan, FORCE_N)
    order = order_of(time_s[rows], [force_n[rows], time_s[rows]])
    np.testing.assert_array_equal(rows[order], N)
    if twice:  # only rows that are alike in all columns are left out
        other_n = force_n[rows]
        other_n[third] = [99.0, np.nan, 99.0]
        assert order_of(time_s[rows], [other_n]) is None


@pytest.mark.parametrize("zeros", [0, 1, 7])
def test_rows_of_zeros_at_the_end_of_an_array_hold_nothing(zeros):
    time_s = np.r_[TIME_S, np.zeros(zeros)]
    force_n = np.r_[FORCE_N, np.zeros((zeros, 3))]
    assert unfilled_rows(time_s, [time_s, force_n]) == zeros
    assert unfilled_rows(np.r_[TIME_S[:1], np.zeros(zeros)], []) == zeros
    force_n[-1, 2] = 1.0
    for held, columns in (
        (time_s, [time_s, force_n]),  # something was measured in them
        (np.zeros(zeros), []),
        (np.r_[TIME_S - 8.0, np.zeros(zeros)], []),  # times that rise to 0
        (np.r_[np.zeros(zeros), TIME_S], []),
    ):
        assert unfilled_rows(held, columns) == 0


@pytest.mark.parametrize(
    "time_s",
    [
        TIME_S,
        np.r_[TIME_S, TIME_S],
        np.r_[TIME_S[200:], TIME_S[:200]],
        np.where(N == 100, 0.0, TIME_S),
        np.where(N == 100, 8.0, TIME_S),
        np.where(N == 100, np.nan, TIME_S)[moved(5, 9, 20)],
        TIME_S[moved(3, 4, 5)[:15]],
        np.repeat(TIME_S, 2)[np.r_[0:100, 104:200, 100:104, 200:800]],
        (TIME_S - 7.0) % 0.25,
    ],
)
def test_a_clock_that_was_set_or_that_tells_nothing_gives_no_order(time_s):
    assert order_of(time_s, [np.arange(len(time_s)) + 0.5]) is None


def test_a_row_alone_with_the_time_and_values_of_another_gives_no_order():
    time_s = np.where(N == 100, TIME_S[96], TIME_S)
    assert order_of(time_s, [np.ones(len(N))]) is None
    time_s[102] = TIME_S[50]
    assert order_of(time_s, [np.ones(len(N))]) is None
    time_s[101] = TIME_S[97]
    assert order_of(time_s, [np.ones(len(N))]) is None
    time_s[102] = TIME_S[102]
    assert order_of(time_s, [np.ones(len(N))]) is not None


@pytest.mark.parametrize("time_s", [TIME_S, np.floor(TIME_S * 250)])
def test_rows_with_the_newest_first_are_turned_round(time_s):
    np.testing.assert_array_equal(order_of(time_s[::-1], [FORCE_N]), N[::-1])


def test_sixteen_rows_are_enough_for_an_order():
    rows = moved(3, 4, 6)[:16]
    np.testing.assert_array_equal(order_of(TIME_S[rows], []), np.argsort(rows))


@pytest.mark.parametrize(
    ("count_s", "wrap_s"),
    [
        (1e-3, 0.256),
        (1e-5, 0.65536),
        (1e-8, 0.16777216),
        (1e-10, 0.4294967296),
        (1e-6, 1.0),
        (1.0, 3600.0),
        (1.0, 43200.0),
        (1.0, 86400.0),
        (1e-3, 3600.0),
    ],
)
@pytest.mark.parametrize("lost", [0, 31])
def test_a_counter_that_wraps_goes_on(count_s, wrap_s, lost):
    step_s = wrap_s / 2**12
    truth_s = wrap_s - step_s * (150.5 - N - lost * (N > 150))
    found_s, notes = continued(truth_s % wrap_s, count_s)
    np.testing.assert_allclose(found_s, truth_s, rtol=1e-9)
    assert notes == [WRAPS]


def test_a_counter_that_lost_more_than_32_rows_at_its_end_has_begun_anew():
    truth_s = 0.256 - (150.5 - N - 33 * (N > 150)) * 1e-4
    found_s, notes = continued(truth_s % 0.256, 1e-3)
    assert notes == [ANEW]
    assert np.diff(found_s)[150] == pytest.approx(1.0)


def test_parts_of_a_second_wrap_only_if_they_count_finer():
    time_s = (0.8 + N / 1000) % 1.0
    assert continued(time_s, 1e-6)[1] == [WRAPS]
    assert continued(time_s, 1.0)[1] == [ANEW]


@pytest.mark.parametrize(("rows", "begins"), [(16, True), (15, False)])
def test_a_clock_begins_anew_if_enough_rows_follow(rows, begins):
    time_s = np.r_[TIME_S, 2.0 + N[:rows] / 1000]
    found_s, notes = continued(time_s, 1e-3)
    assert notes == ([ANEW] if begins else [])
    assert (np.diff(found_s) > 0).all() == begins
    if begins:
        np.testing.assert_allclose(np.diff(found_s)[len(N) - 1 :], [1.0, *[1e-3] * (rows - 1)])


def test_a_clock_may_begin_anew_twice_and_wrap():
    time_s = np.r_[TIME_S, 2.0 + N[:100] / 1000, 1.0 + N[:100] / 1000, (0.2 + N / 1000) % 0.256]
    found_s, notes = continued(time_s, 1e-3)
    assert notes == [ANEW, WRAPS]
    steps_s = np.diff(found_s)
    np.testing.assert_array_equal(np.flatnonzero(steps_s > 0.9), [399, 499, 599])
    np.testing.assert_allclose(np.delete(steps_s, [399, 499, 599]), 1e-3)


@pytest.mark.parametrize(
    "time_s",
    [
        np.where(N == 100, 2.0, TIME_S),
        np.where(N == 100, 9.0, TIME_S),
        np.r_[TIME_S, 9.0, TIME_S[:20]],
        np.r_[TIME_S, 2.0 + N[:10] / 1000, 2.0 + N[:100] / 1000],
        2.0 + N % 16 / 1000,
        0.032 * N % 0.256,
        np.r_[TIME_S[:50], np.full(20, 3.0)],
        np.where(N % 15, TIME_S, 0.0),
        TIME_S,
        TIME_S[:1],
    ],
)
def test_other_times_are_left_as_they_are(time_s):
    found_s, notes = continued(time_s, 1e-3)
    np.testing.assert_array_equal(found_s, time_s)
    assert notes == []


def test_summer_time_skips_an_hour_of_the_day():
    time_s = 7200.0 - 0.2 + N / 1000 + np.where(N >= 200, 3600.0, 0.0)
    found_s, notes = continued(time_s, 1.0, of_day=True)
    np.testing.assert_allclose(found_s, 7200.0 - 0.2 + N / 1000)
    assert notes == ["skips an hour, which was left out"]
    assert continued(time_s, 1.0)[1] == []
    longer_s = time_s + np.where(N >= 200, 0.1, 0.0)
    assert continued(longer_s, 1.0, of_day=True)[1] == []


def samples(time_s, **values):
    values = values or {"force": FORCE_N[: len(time_s)]}
    return Samples(values, dict.fromkeys(values, time_s), dict.fromkeys(values, "row {}".format))


def test_rows_with_the_time_and_values_of_the_row_before_count_once():
    rows = np.sort(np.r_[N, 5, 5, 99])
    both = samples(TIME_S[rows], force=FORCE_N[rows], position=0.0 * FORCE_N[rows])
    found = both.without_repeats()
    for channel in ("force", "position"):
        np.testing.assert_array_equal(found.times[channel], TIME_S)
        np.testing.assert_array_equal(
            found.values[channel], both.values[channel][np.unique(rows, return_index=True)[1]]
        )
        assert found.row_name(channel, 100) == "row 103"
    assert found.times["force"] is found.times["position"]
    assert found.notes == ("force, position: 3 rows were written twice and left out",)
    held = samples(TIME_S, position=FORCE_N)
    apart = replace(
        both,
        values={"position": FORCE_N, "force": FORCE_N[rows]},
        times={"position": TIME_S, "force": TIME_S[rows]},
    )
    assert held.without_repeats().notes == ()
    assert apart.without_repeats().notes == ("force: 3 rows were written twice and left out",)
    changed = samples(
        TIME_S[rows], force=FORCE_N[rows], position=np.arange(len(rows))[:, None] + FORCE_N[rows]
    )
    assert changed.without_repeats().notes == ()


def test_rows_with_blanks_are_left_out_of_their_channel():
    force_n = np.where(N[:, None] == [3, 4, 4], np.nan, FORCE_N)
    time_s = np.where(N == 9, np.nan, TIME_S)
    found = samples(time_s, force=force_n, position=FORCE_N).without_blanks()
    assert len(found.times["force"]) == len(found.values["force"]) == len(N) - 3
    assert len(found.times["position"]) == len(N) - 1
    assert found.row_name("force", 3) == "row 5"
    alike = samples(time_s, force=FORCE_N, position=FORCE_N).without_blanks()
    assert alike.times["force"] is alike.times["position"]


SET = (
    "the time of force jumps by 4999992.99 s in row 9, as of a clock that was set; import the "
    "parts by themselves, or say the rows a second (--rate HZ)"
)
LONG = (
    "the times of force span {} s, a session lasts 49 days at most; say their unit, as in --unit "
    "time=ms (or us, ns)"
)
FAST = (
    "force has 2e+06 rows a second; say the unit of its times, as in --unit time=d for dates of "
    "Excel and MATLAB"
)
INFINITE = "the time of force is inf in row 3; --blanks-as-gaps leaves out such rows"


@pytest.mark.parametrize(
    ("time_s", "message"),
    [
        (TIME_S[:1], "force has 1 rows, at least 2 are needed"),
        (np.where(N == 3, np.inf, TIME_S), INFINITE),
        (
            np.where(N == 3, 1.5, TIME_S),
            "the time of force is 1.5 s in row 3, after 7.002 s; times must not fall (--rate HZ "
            "takes even rows without them)",
        ),
        (np.where(N < 9, TIME_S, 5e6), SET),
        (np.r_[TIME_S[:9], 2.15e6 + 3.5, np.full(5, 4.3e6)], LONG.format("4.3e+06")),
        (N * 1.1e4, LONG.format("4.39e+06")),
        (TIME_S / 2000, FAST),
    ],
)
def test_times_of_no_recording_are_refused_with_their_row(time_s, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        samples(time_s).check()


def test_times_up_to_the_bounds_are_taken():
    for time_s in (N * 1.05e4, TIME_S / 1000, np.full(400, 3.0), TIME_S[:2], TIME_S + 1.7e9):
        samples(time_s).check()


def test_values_that_no_frame_holds_are_refused_with_their_row():
    largest = float(np.finfo(np.float32).max)
    samples(TIME_S, force=np.where(N[:, None] == 9, -largest, FORCE_N)).check()
    for value, what, hint in (
        (np.nan, "empty or NaN", "--blanks-as-gaps"),
        (2 * largest, "6.8", ""),
    ):
        force_n = np.where(N[:, None] == [8, 9, 9], value, FORCE_N)
        with pytest.raises(
            InputError, match=rf"^force_x is {what}.* in row 8, and 1 more rows.*{hint}"
        ):
            samples(TIME_S, force=force_n).check()
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (400, 1))
    samples(TIME_S, orientation=turns).check()
    turns[[7, 9]] *= [[1.5], [2.5]]
    with pytest.raises(
        InputError,
        match=r"orientation is 1.5 long in row 7, and 1 more rows are no unit quaternions$",
    ):
        samples(TIME_S, orientation=turns).check()
