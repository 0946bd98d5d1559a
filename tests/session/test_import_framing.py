"""Rows on a grid of 1 kHz become frames as they are, others are put on it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.session.data import sample_times
from mmt.session.importing.framing import to_frames
from mmt.session.importing.samples import ROW_NUMBER, Samples


def samples(values, times, sequence=None):
    names = dict.fromkeys(values, ROW_NUMBER.format)
    return Samples(values, times, names, sequence)


def rows(steps, several, off_s=0.0, shift_s=0.0, channels=("position", "acceleration")):
    """Return a motion at numbers of frames, off their times, a shifted acceleration, and those."""
    numbers = np.cumsum([0, *steps])
    time_s = 5.0 + numbers / 1e3 + off_s * np.resize([1.0, -1.0], len(numbers))
    fast_s = time_s if several == 1 else sample_times(time_s, several, 1e-3) + shift_s
    times = {"position": time_s, "acceleration": fast_s}
    made = np.random.default_rng(1).normal(size=(len(fast_s), 3)).astype("f4").astype(float)
    values = {"position": np.outer(time_s, [10.0, 0.0, 1.0]), "acceleration": made}
    return samples({c: values[c] for c in channels}, {c: times[c] for c in channels}), numbers


steps = st.lists(st.sampled_from([1, 1, 1, 3]), min_size=20, max_size=40).filter(
    lambda steps: np.median(steps) == 1
)


@settings(max_examples=50)
@given(steps, st.integers(1, 10), st.floats(0.0, 1.0), st.booleans())
def test_rows_on_the_grid_are_frames_as_they_are(steps, several, share, alone):
    off_s = share * 0.09e-3 / several
    channels = ("acceleration",) if alone and several == 1 else ("position", "acceleration")
    shift_s = share * 0.19e-3 / several if several > 1 else 0.0
    given_rows, numbers = rows(steps, several, off_s, shift_s, channels)
    frames, stamps, resampled = to_frames(given_rows, acceleration_rate_hz=1000 * several)
    assert not resampled
    np.testing.assert_array_equal(frames["sequence"], numbers)
    time_s = next(iter(given_rows.times.values()))
    np.testing.assert_array_equal(frames["time_ns"], np.rint(1e9 * (time_s - time_s[0])))
    found = frames["acceleration_m_s2"].reshape(-1, 3)
    np.testing.assert_array_equal(found, given_rows.values["acceleration"])
    assert set(stamps) == set(channels)
    for channel, each in stamps.items():
        count = several if channel == "acceleration" else 1
        assert each.period_s == pytest.approx(1e-3 / count)
        assert each.missing_rows == count * (numbers[-1] + 1 - len(numbers))
        assert each.jitter_s == pytest.approx(off_s, rel=0.01, abs=1e-9)
        assert each.largest_s == pytest.approx(off_s, rel=0.06, abs=1e-9)
        assert (each.periodic, each.regular) == (True, False)
        np.testing.assert_allclose(each.time_s, given_rows.times[channel], atol=1.01 * shift_s)


@pytest.mark.parametrize(
    ("step", "several", "off_s", "shift_s", "rate_hz"),
    [
        *((step, 1, off_s, 0.0, None) for step, off_s in ((1, 0.11e-3), (2, 0.0))),
        *((1, several, 0.0, 0.0, rate) for several, rate in ((2, None), (1, 2000), (4, 3000))),
        (1, 4, 0.0, 0.051e-3, 4000),
    ],
)
def test_other_rows_are_put_on_the_grid(step, several, off_s, shift_s, rate_hz):
    given_rows, numbers = rows([step] * 99, several, off_s, shift_s)
    frames, stamps, resampled = to_frames(given_rows, acceleration_rate_hz=rate_hz)
    assert resampled
    assert set(stamps) == {"position", "acceleration"}
    np.testing.assert_array_equal(np.diff(frames["sequence"]), 1)
    np.testing.assert_array_equal(frames["time_ns"], 1_000_000 * frames["sequence"])
    assert numbers[-1] - 4 <= len(frames) <= numbers[-1] + 1
    shape = (len(frames), 3) if rate_hz in (None, 1000) else (len(frames), rate_hz // 1000, 3)
    assert frames["acceleration_m_s2"].shape == shape


@settings(max_examples=30)
@given(
    st.sampled_from([0, 7, 2**32 - 402]),
    st.floats(-0.0098, 0.0098),
    st.integers(1, 4),
    st.booleans(),
)
def test_an_exported_session_keeps_its_numbers(first, drift, several, alone):
    channels = ("acceleration",) if alone else ("position", "acceleration")
    given_rows, numbers = rows([1] * 200 + [2] + [1] * 199, several, channels=channels)
    drift *= several == 1
    times = {channel: (1 + drift) * given_rows.times[channel] for channel in channels}
    times |= {} if alone or several > 1 else {"acceleration": times["position"]}
    frames, stamps, resampled = to_frames(samples(given_rows.values, times, first + numbers * 1.0))
    assert stamps["acceleration"].missing_rows == several
    assert not resampled
    np.testing.assert_array_equal(frames["sequence"], first + numbers)
    assert frames["acceleration_m_s2"].size == 3 * several * len(frames)
    for start, more in ((-1.0, 0.0), (2.0**32 - 401, 0.0), (first, 0.0103 * (several == 1))):
        times = {c: (1 + more) * given_rows.times[c] for c in channels}
        times |= {} if alone or several > 1 else {"acceleration": times["position"]}
        again = samples(given_rows.values, times, start + numbers * 1.0)
        frames, _, resampled = to_frames(again, acceleration_rate_hz=1000 * several)
        assert resampled == (more > 0)
        assert (frames["sequence"][0] == 0) == (start != first or more > 0 or first == 0)


def test_numbers_that_repeat_are_not_those_of_frames():
    given_rows, numbers = rows([1] * 99, 1)
    again = samples(given_rows.values, given_rows.times, 7.0 + numbers - (numbers == 50))
    np.testing.assert_array_equal(to_frames(again)[0]["sequence"], numbers)
    position = samples({"position": given_rows.values["position"]}, {"position": numbers / 1e3})
    assert not to_frames(position, acceleration_rate_hz=2000)[2]
    fast = {"position": numbers / 1e3, "acceleration": np.arange(250) / 2500}
    values = {"position": given_rows.values["position"], "acceleration": np.ones((250, 3))}
    assert to_frames(samples(values, fast))[2]


def test_a_gap_is_filled_up_to_the_longest_that_is_said():
    given_rows, _ = rows([1] * 40 + [30] + [1] * 40, 1, 0.11e-3)
    for longest_gap_s, step in ((None, 30), (0.05, 1)):
        frames = to_frames(given_rows, longest_gap_s)[0]
        assert np.diff(frames["sequence"]).max() == pytest.approx(step, abs=2 * (step > 1))


@pytest.mark.parametrize("channel", ["position", "force"])
def test_what_changes_smoothly_decides_whether_the_stamps_are_kept(channel):
    time_s = np.arange(3000) / 500 + 4e-4 * np.random.default_rng(7).uniform(-1, 1, 3000)
    time_s = np.sort(time_s)
    values = {channel: 40 * np.sin(4 * time_s)[:, None] * [1, 1, 1]}
    values["acceleration"] = np.random.default_rng(1).normal(size=(3000, 3))
    both = samples(values, dict.fromkeys(values, time_s))
    assert {each.regular for each in to_frames(both)[1].values()} == {False}
    assert {each.regular for each in to_frames(both, choice="regular")[1].values()} == {True}
    alone = samples({"acceleration": values["acceleration"]}, {"acceleration": time_s})
    assert to_frames(alone)[1]["acceleration"].regular
    apart = samples(values, {channel: time_s, "acceleration": time_s.copy()})
    assert [each.regular for each in to_frames(apart)[1].values()] == [False, True]


def test_stamps_that_are_equal_and_channels_apart_are_refused():
    time_s = np.sort(np.random.default_rng(3).uniform(0, 1, 15))
    time_s[5] = time_s[4]
    with pytest.raises(InputError, match=r"^the time of force is .* in row 5, .*--rate HZ"):
        to_frames(samples({"force": np.ones((15, 3))}, {"force": time_s}))
    apart = {"force": np.arange(20) / 500, "position": 9 + np.arange(20) / 500}
    with pytest.raises(InputError, match=r"^no frame can be made.* has .* to .* s.*--unit time=ms"):
        to_frames(samples({c: np.ones((20, 3)) for c in apart}, apart))
