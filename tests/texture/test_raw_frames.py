"""Raw frames, fed to the stream filter and the modeller: the right result, or an error."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.online.history import build_model
from mmt.texture.online.modeller import OnlineModeller
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.bridging import LARGEST_MEASUREMENT
from mmt.texture.signals.filtering import StreamFilter

SETTINGS = ModellingSettings(order=6)


@pytest.fixture(scope="module")
def stroked():
    return simulate_session(Scene(), surface="wood", duration_s=5.0)[0]


def modelled(frames, period=1000):
    modeller = OnlineModeller(SETTINGS)
    for start in range(0, len(frames), period):
        modeller.update(frames[start : start + period])
    return modeller


def contents(modeller):
    return modeller.model.to_bytes()


@pytest.mark.parametrize("period", [1000, 700])
def test_a_sequence_that_starts_again_is_modelled_on(stroked, period):
    again = stroked.copy()
    again["time_ns"] += 10_000_000_000
    both = np.concatenate([stroked, again])
    modeller = modelled(both, period)
    update = modeller.update(both[:0])
    assert 11.0 <= update.time_s <= 12.0  # with the gap
    assert len(modeller.fits) >= 2 * len(modelled(stroked, period).fits) - 2
    if period == 1000:
        offline = build_model(both, SETTINGS).updates[-1].model
        assert contents(modeller) == offline.to_bytes()


@settings(max_examples=20)
@given(st.integers(0, 2**32), st.sampled_from(["shuffled", "reversed", "equal", "any"]))
def test_times_in_any_order_give_the_same_model(seed, kind):
    random = np.random.default_rng(seed)
    frames = STILL.copy()
    times = {
        "shuffled": random.permutation(frames["time_ns"]),
        "reversed": frames["time_ns"][::-1],
        "equal": np.zeros(len(frames), np.int64),
        "any": random.integers(-(2**63), 2**63 - 1, len(frames)),
    }
    frames["time_ns"] = times[kind]
    ours, expected = StreamFilter().process(frames), StreamFilter().process(STILL)
    for name in ("index", "speed_mm_s", "normal_force_n", "vibration_m_s2", "valid", "measured"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(expected, name))


def lossy():
    frames = simulate_session(Scene(), surface="wood", duration_s=1.0)[0]
    return frames[np.random.default_rng(0).random(len(frames)) > 0.02]


STILL = lossy()


@settings(max_examples=10)
@given(
    st.integers(0, 2**32),
    st.sampled_from(["position_mm", "force_n", "acceleration_m_s2"]),
    st.sampled_from([np.nan, np.inf, -np.inf, -2.0 * LARGEST_MEASUREMENT, 1e30]),
)
def test_a_frame_that_is_no_measurement_counts_as_missing(seed, channel, value):
    broken = np.random.default_rng(seed).random(len(STILL)) < 0.02
    broken[0] = broken[-1] = False
    frames = STILL.copy()
    frames[channel][broken, 2] = value
    one, other = StreamFilter(), StreamFilter()
    ours, expected = one.process(frames), other.process(STILL[~broken])
    for name in ("index", "speed_mm_s", "normal_force_n", "vibration_m_s2", "valid", "measured"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(expected, name))
    assert round(1000 * one.faults.not_finite_s) == broken.sum()


@pytest.mark.parametrize(
    "frames", [None, [1, 2], "frames", np.zeros((5, 3)), STILL[0], STILL[:10].reshape(2, 5)]
)
def test_what_are_no_frames_is_refused(frames):
    for take in (StreamFilter().process, OnlineModeller(SETTINGS).update, build_model):
        with pytest.raises(InputError, match=r"a structured array \(n,\) is needed"):
            take(frames)


@pytest.mark.parametrize("given_settings", ["published", {"order": 6}, 6])
def test_what_are_no_settings_is_refused(given_settings):
    for make in (OnlineModeller, lambda given: build_model(STILL, given)):
        with pytest.raises(InputError, match=r"settings is .*, allowed is ModellingSettings"):
            make(given_settings)


@pytest.mark.parametrize("period_s", [np.nan, 0, -1.0, np.inf, "1", None])
def test_a_period_of_no_length_is_refused(period_s):
    with pytest.raises(InputError, match=r"update_s is .*, allowed is a finite number above 0"):
        build_model(STILL, update_s=period_s)
