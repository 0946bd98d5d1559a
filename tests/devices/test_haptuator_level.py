"""The level of a Haptuator and its equaliser: fitted, stored, and used."""

import json
import math
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from unittest import mock

import numpy as np
import platformdirs
import pytest
from command_runs import refusal, run_json
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from mmt.core.errors import InputError
from mmt.devices.calibrations import save_calibration
from mmt.devices.haptuator.driver import VoltageDrive, level_of, store_level
from mmt.devices.haptuator.equaliser import (
    TAPS,
    ActuatorLevel,
    fit_equaliser,
    sweep,
    taps_at,
)
from mmt.devices.haptuator.options import HaptuatorOptions
from mmt.evaluation.strokes_made import at_skin
from mmt.texture.synthesis.actuator import FREQUENCIES_HZ, ActuatorResponse


def actuator(volts):
    """Resonate around 150 Hz, with 3 m/s2 per volt beside that."""
    b, a = signal.iirfilter(1, [120.0, 180.0], fs=1000.0, btype="band")
    return 8.0 * signal.lfilter(b, a, volts) + 3.0 * volts


def heard(noise_m_s2=0.05, late=17):
    volts = sweep(2.0, 60.0, 490.0, 6.0)
    noise = np.random.default_rng(1).normal(0.0, noise_m_s2, len(volts))
    return volts, np.roll(actuator(volts), late) + noise


SPOILT = st.one_of(st.none(), st.text(), st.sampled_from([math.nan, math.inf, 10**400, [1.0]]))


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_data_path", lambda *_args, **_options: tmp_path)
    return tmp_path


@pytest.mark.parametrize("late", [-30, 0, 17])
def test_a_resonance_is_evened_out_and_the_level_found(late):
    fitted = fit_equaliser(*heard(late=late))
    assert fitted.unevenness_db > 3.0
    assert fitted.remaining_db < 0.5
    assert fitted.coherence > 0.99
    # against the actuator itself, tone by tone
    for frequency_hz in (100.0, 150.0, 200.0, 300.0, 400.0):
        wanted = np.sin(2.0 * np.pi * frequency_hz * np.arange(2000) / 1000.0)
        volts = fitted.volts_per_m_s2 * signal.lfilter(fitted.taps, [1.0], wanted)
        rms = np.sqrt(np.mean(actuator(volts)[500:1500] ** 2))
        assert rms == pytest.approx(np.sqrt(0.5), rel=0.06)


@settings(max_examples=25)
@given(st.floats(1.0, 30.0), st.integers(0, 1000), st.floats(0.001, 1000.0))
def test_the_equalisers_gain_is_bounded_for_any_actuator(largest_gain_db, seed, gain):
    volts = np.random.default_rng(seed).normal(size=6000)
    response = gain * np.random.default_rng(seed + 1).normal(size=12)
    acceleration = signal.lfilter(response, [1.0], volts)
    fitted = fit_equaliser(volts, acceleration, largest_gain_db=largest_gain_db)
    magnitude = np.abs(np.fft.rfft(fitted.taps, 1024))
    assert np.all(magnitude <= 10.0 ** (largest_gain_db / 20.0) * 1.01)
    assert len(fitted.taps) <= TAPS
    assert np.isfinite(fitted.volts_per_m_s2)
    assert fitted.volts_per_m_s2 > 0.0


def coil(volts, resonance_hz):
    """A voice coil's mass on a spring, 15 m/s2 for a volt above its resonance (bilinear)."""
    rate = 2.0 * np.pi * resonance_hz
    b, a = signal.bilinear([15.0, 0.0, 0.0], [1.0, 0.4 * rate, rate * rate], 1000.0)
    return signal.lfilter(b, a, volts)


@pytest.mark.parametrize("resonance_hz", [50.0, 80.0, 150.0])
def test_the_band_begins_where_the_actuator_can_still_be_raised(resonance_hz, home):
    """Its mass falls off by 12 dB an octave below the resonance, and 12 dB is the largest gain."""
    volts = sweep(1.0, 20.0, 490.0, 8.0)
    noise = np.random.default_rng(4).normal(0.0, 0.01, len(volts))
    fitted = fit_equaliser(volts, coil(volts, resonance_hz) + noise)
    assert 0.35 * resonance_hz < fitted.low_hz < 0.7 * resonance_hz + 4.0
    assert home in store_level(fitted, "TL 17").parents
    options = HaptuatorOptions(serial="TL 17", full_scale_v=50.0, limit_v=50.0)
    assert asdict(level_of(options)).items() <= asdict(fitted).items()
    drive = VoltageDrive(options, 1000.0)
    assert drive.low_hz == pytest.approx(fitted.low_hz)
    assert drive.gain(np.array([fitted.response_hz[0] - 0.1])) == 0.0
    # what is told of the way to the skin is what a texture's noise makes of it
    sos = signal.butter(2, [40.0, 160.0], "bandpass", fs=1000.0, output="sos")
    texture = signal.sosfilt(sos, np.random.default_rng(5).normal(size=60_000))
    felt = coil(np.array(drive.convert(texture)), resonance_hz)
    measured = np.mean(felt[1000:] ** 2) / np.mean(texture[1000:] ** 2)
    density = np.abs(signal.sosfreqz(sos, FREQUENCIES_HZ, fs=1000.0)[1]) ** 2
    response = ActuatorResponse(drive.gain(FREQUENCIES_HZ), drive.low_hz)
    told = response.played_share(density[np.newaxis])[0]
    assert 10.0 * np.log10(told / measured) == pytest.approx(0.0, abs=0.4)
    again = ActuatorResponse.from_dict(json.loads(json.dumps(response.as_dict())))
    np.testing.assert_allclose(again.gain, response.gain, atol=1e-4)


NO_SIZE = st.one_of(
    st.none(), st.text(), st.lists(st.floats()), st.sampled_from([10**400, -(10**400), -1e-9]),
    st.floats().filter(lambda value: not 0.0 <= value <= 1e6),
)  # fmt: skip


@given(NO_SIZE, st.integers(0, 97), st.integers(0, 200).filter(lambda count: count != 98))
def test_a_recording_that_tells_no_response_of_an_actuator_is_explained(value, place, count):
    gain = [1.0] * 98
    spoilt = [*gain[:place], value, *gain[place + 1 :]]
    for gains, low_hz, name in (
        (spoilt, 90.0, "gain"), ([1.0] * count, 90.0, "gain"), (value, 90.0, "gain"),
        (gain, value, "low_hz"),
    ):  # fmt: skip
        event = {"event": "actuator response", "gain": gains, "low_hz": low_hz}
        session = SimpleNamespace(path=Path("a.mcap"), events=[event])
        strokes = SimpleNamespace(force_n=np.ones(1))
        with pytest.raises(InputError, match=f"a.mcap.*'actuator response' {name} must be"):
            at_skin(session, object(), None, strokes)


def test_what_tells_nothing_is_refused():
    volts, acceleration = heard()
    noise = np.random.default_rng(3).normal(size=len(volts))
    broken = acceleration.copy()
    broken[5] = np.nan
    for pair, words in (
        ((volts, noise), "raise the level"),
        ((volts[:500], acceleration[:500]), "at least"),
        ((volts, acceleration[:-1]), "one length"),
        ((volts, broken), "finite"),
        ((0.0 * volts, acceleration), "zero throughout"),
        ((np.where(np.arange(len(volts)) < 1, 1.0, 0.0), acceleration), "explains 0 % of"),
    ):
        with pytest.raises(InputError, match=words):
            fit_equaliser(*pair)
    with pytest.raises(InputError, match="allowed are"):
        fit_equaliser(volts, acceleration, low_hz=300.0, high_hz=200.0)
    with pytest.raises(InputError, match="rising"):
        sweep(1.0, 0.0, 400.0, 5.0)


def test_the_command_fits_and_stores_or_explains_what_it_cannot_use(home):
    recording = home / "sweep.npz"
    arguments = "device", "equalise", recording, "--serial", "A7"
    assert "drive_v" in refusal(*arguments)  # there is no file
    np.savez(recording, drive_v=np.zeros(10))
    assert "drive_v" in refusal(*arguments)
    volts, acceleration = heard()
    np.savez(recording, drive_v=volts, acceleration_m_s2=acceleration)
    fitted, (written, _) = fit_equaliser(volts, acceleration), run_json(home, *arguments)
    assert written["volts_per_m_s2"] == pytest.approx(fitted.volts_per_m_s2)
    options = HaptuatorOptions(serial="A7", full_scale_v=6.0)
    assert level_of(options).taps == pytest.approx(fitted.taps)


@pytest.mark.parametrize("k", [2, 5, 10])
def test_an_equaliser_has_the_same_gain_at_any_rate(k):
    fitted = fit_equaliser(*heard())
    rate_hz, hz = 1000.0 * k, np.arange(1.0, 500.0)
    taps = taps_at(fitted.taps, rate_hz)
    assert len(taps) == k * TAPS
    _, before = signal.freqz(fitted.taps, worN=hz, fs=1000.0)
    _, after = signal.freqz(taps, worN=hz, fs=rate_hz)
    np.testing.assert_allclose(np.abs(after), np.abs(before), rtol=0.01)
    _, above = signal.freqz(taps, worN=np.linspace(500.0, 500.0 * k, 200), fs=rate_hz)
    np.testing.assert_allclose(np.abs(above), abs(np.polyval(fitted.taps, -1.0)), rtol=0.01)
    options = HaptuatorOptions(volts_per_m_s2=0.01, full_scale_v=6.0, low_hz=20.0)
    drive = VoltageDrive(options, rate_hz, ActuatorLevel(0.01, fitted.taps))
    values = np.random.default_rng(1).normal(size=(40, k))
    volts = np.concatenate([drive.convert(tick) for tick in values])
    sections = [signal.butter(2, 20.0, "highpass", fs=rate_hz)]
    if k > 2:
        sections.append(signal.bessel(2, 1000.0, fs=rate_hz, norm="mag"))
    wanted = values.ravel()
    for b, a in [*sections, (taps, 1.0)]:
        wanted = signal.lfilter(b, a, wanted)
    np.testing.assert_allclose(volts, 0.01 * wanted, atol=1e-12)


def test_what_is_stored_and_useless_is_explained(home):
    options = HaptuatorOptions(serial="x", full_scale_v=6.0)
    with pytest.raises(InputError, match=r"x is stored: make one by .*, or give 'volts_per_m_s2'"):
        level_of(options)
    for values in (
        {},
        {"volts_per_m_s2": -1.0, "taps": [1.0]},
        {"volts_per_m_s2": 0.1, "taps": []},
        {"volts_per_m_s2": 0.1, "taps": ["a"]},
        {"volts_per_m_s2": 0.1, "taps": [1.0] * (TAPS + 1)},
    ):
        path = save_calibration("haptuator", "x", values)
        with pytest.raises(InputError, match=f"{path} is not that of a Haptuator: make it again"):
            level_of(options)


@given(
    st.lists(st.tuples(st.floats(0.0, 500.0), st.floats(0.0, 50.0)), max_size=6),
    st.lists(st.tuples(st.integers(0, 1), st.integers(0, 5), SPOILT), max_size=2),
)
def test_a_stored_response_is_taken_in_pairs_or_refused(pairs, spoils):
    lists = [[at for at, _ in pairs], [gain for _, gain in pairs]]
    for which, place, value in spoils:
        lists[which][place : place + 1] = [value]
    with TemporaryDirectory() as home, mock.patch("platformdirs.user_data_path") as found:
        found.return_value = Path(home)
        values = {"volts_per_m_s2": 0.1, "taps": [1.0], "response_hz": lists[0]}
        save_calibration("haptuator", "x", {**values, "response": lists[1]})
        try:
            level = level_of(HaptuatorOptions(serial="x", full_scale_v=6.0))
        except InputError as error:
            rising = all(low < high for (low, _), (high, _) in pairwise(pairs))
            assert spoils or not rising
            assert "make it again" in str(error)  # noqa: PT017 - it may be taken as well
        else:
            assert [list(level.response_hz), list(level.response)] == lists
