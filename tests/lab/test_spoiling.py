"""What spoils a session: each does what it says, and nothing else."""

import numpy as np
import pytest

from mmt.core.frames import empty_frames
from mmt_lab.compare.spoiling import LASTS_S, MOMENT_S, SPOILS, spoilt


@pytest.fixture(scope="module")
def frames():
    count = 15_000
    made = empty_frames(count, ("position", "force", "acceleration"))
    made["sequence"] = np.arange(count)
    made["time_ns"] = 5_000_000_000 + 1_000_000 * np.arange(count)
    made["acceleration_m_s2"] = np.random.default_rng(1).standard_normal((count, 3))
    made["acceleration_m_s2"][:, 2] += 9.81
    return made


def acceleration(frames, name):
    return spoilt(frames, name, 7)["acceleration_m_s2"].astype(np.float64)


BEGIN, END = round(1000 * MOMENT_S), round(1000 * (MOMENT_S + LASTS_S))


@pytest.mark.parametrize("name", SPOILS)
def test_all_is_as_it_was_before_the_moment_and_in_other_channels(frames, name):
    kept = frames.copy()
    found = spoilt(frames, name, 7)
    np.testing.assert_array_equal(frames, kept)
    same = np.isin(frames["sequence"], found["sequence"])
    for channel in ("time_ns", "position_mm", "force_n"):
        np.testing.assert_array_equal(found[channel], frames[channel][same])
    if not name.startswith("lost"):
        assert same.all()
        own, whole = found["acceleration_m_s2"], frames["acceleration_m_s2"]
        np.testing.assert_array_equal(own[:BEGIN], whole[:BEGIN])
        changed = np.flatnonzero((own != whole).any(axis=1))
        assert changed[0] in (BEGIN, BEGIN + 1)
        lasts = {"unplugged": 2000, "drift": 3000, "knock": 10, "spike": 1}.get(name, 300)
        assert changed[-1] < BEGIN + lasts
    np.testing.assert_array_equal(found, spoilt(frames, name, 7))


@pytest.mark.parametrize("by_db", [20, 40])
def test_a_quieter_moment_is_so_many_decibels_quieter_about_gravity(frames, by_db):
    own = acceleration(frames, f"quiet-{by_db}")[BEGIN:END]
    whole = frames["acceleration_m_s2"][BEGIN:END]
    ratio_db = 20.0 * np.log10(whole.std(axis=0) / own.std(axis=0))
    np.testing.assert_allclose(ratio_db, by_db, atol=0.01)
    np.testing.assert_allclose(own.mean(axis=0), whole.mean(axis=0), atol=1e-5)


def test_held_unplugged_and_saturated_sensors_carry_nothing(frames):
    assert (np.ptp(acceleration(frames, "held")[BEGIN:END], axis=0) == 0.0).all()
    assert not acceleration(frames, "unplugged")[BEGIN : BEGIN + 2000].any()
    saturated = np.abs(acceleration(frames, "saturated")[BEGIN:END])
    assert np.mean(saturated == saturated.max()) > 0.6


def test_what_is_added_has_the_size_stated(frames):
    def added(name):
        return acceleration(frames, name) - frames["acceleration_m_s2"].astype(np.float64)

    assert np.abs(added("knock")).max() == pytest.approx(60.0, abs=0.1)
    assert np.abs(added("hum")).max() == pytest.approx(5.0, abs=0.01)
    spectrum = np.abs(np.fft.rfft(added("hum")[BEGIN:END, 0]))
    assert np.fft.rfftfreq(END - BEGIN, 0.001)[spectrum.argmax()] == pytest.approx(50.0, abs=2)
    assert added("spike").sum() == pytest.approx(60.0, abs=0.01)
    assert added("drift")[-1] == pytest.approx(1.5, abs=0.01)


@pytest.mark.parametrize("share", [1, 2, 5])
@pytest.mark.parametrize(("suffix", "together"), [("", 1), ("-in-threes", 3)])
def test_as_many_frames_are_lost_as_stated(frames, share, suffix, together):
    found = spoilt(frames, f"lost-{share}{suffix}", 3)
    assert 1.0 - len(found) / len(frames) == pytest.approx(0.01 * share, rel=0.25)
    gaps = np.diff(found["sequence"].astype(int)) - 1
    assert np.median(gaps[gaps > 0]) == together
    assert found["sequence"][0] == 0
