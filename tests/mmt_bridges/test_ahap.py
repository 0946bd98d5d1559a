"""Apple patterns: the level and mean frequency of each moment, as Core Haptics would read them."""

import json

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt_bridges.haptics.ahap import moments, write_ahap


def read(path):
    """Return the events, and by parameter all points of (time, value), as a player takes them.

    A player keeps sixteen points of a curve; one that ends where the next begins leaves no gap.
    """
    document = json.loads(path.read_text())
    assert document.keys() == {"Version", "Pattern"}
    events = []
    curves = {}
    for entry in document["Pattern"]:
        if "Event" in entry:
            events.append(entry["Event"])
        else:
            curve = entry["ParameterCurve"]
            points = curve["ParameterCurveControlPoints"]
            assert 2 <= len(points) <= 16
            assert points[0]["Time"] == 0.0
            taken = np.array([(curve["Time"] + p["Time"], p["ParameterValue"]) for p in points])
            before = curves.get(curve["ParameterID"])
            if before is not None:
                np.testing.assert_allclose(taken[0], before[-1], atol=1e-9)
                taken = np.concatenate([before, taken[1:]])
            assert np.all(np.diff(taken[:, 0]) > 0)
            curves[curve["ParameterID"]] = taken
    return events, curves


@pytest.mark.parametrize("rate_hz", [2000, 11_025, 44_100])
def test_a_growing_sine_has_its_level_and_frequency(rate_hz, tmp_path):
    time_s = np.arange(rate_hz) / rate_hz
    samples = (1.0 + 3.0 * time_s) * np.sin(2.0 * np.pi * 200.0 * time_s)
    written = write_ahap(tmp_path / "x.ahap", samples, rate_hz, 5.0)
    assert written == (1.0, 5.0)
    (event,), curves = read(tmp_path / "x.ahap")
    assert (event["EventType"], event["Time"]) == ("HapticContinuous", 0.0)
    assert event["EventDuration"] == 1.0
    at_s, intensity = curves["HapticIntensityControl"].T
    assert (at_s[0], at_s[-1]) == (0.0, 1.0)
    np.testing.assert_allclose(intensity[1:-1] * 5.0, 1.0 + 3.0 * at_s[1:-1], rtol=0.02)
    np.testing.assert_allclose(intensity[[0, -1]] * 5.0, [1.0, 4.0], rtol=0.1)
    sharpness = curves["HapticSharpnessControl"][1:-1, 1]
    np.testing.assert_allclose(sharpness, (200.0 - 65.0) / (300.0 - 65.0), atol=0.03)


@pytest.mark.parametrize("count", [1, 2, 290, 300, 310, 320, 5000])
def test_the_curves_together_are_the_moments(count, tmp_path):
    samples = np.random.default_rng(count).standard_normal(count)
    write_ahap(tmp_path / "x.ahap", samples, 1000, 10.0)
    _, curves = read(tmp_path / "x.ahap")
    times_s, amplitude, _ = moments(samples, 1000)
    np.testing.assert_allclose(curves["HapticIntensityControl"][:, 0], times_s, atol=2e-6)
    np.testing.assert_allclose(curves["HapticIntensityControl"][:, 1], amplitude / 10, atol=1e-5)


def test_silence_is_still_and_too_loud_and_too_sharp_are_clipped(tmp_path):
    sharp = np.sin(2.0 * np.pi * 400.0 * np.arange(2000) / 2000.0)
    for samples, level in ((np.zeros(2000), 0.0), (sharp, 1.0)):
        write_ahap(tmp_path / "x.ahap", samples, 2000, 0.1)
        _, curves = read(tmp_path / "x.ahap")
        assert all((curve[:, 1] == level).all() for curve in curves.values())


def test_long_vibration_is_events_of_half_a_minute_beside_its_sound(tmp_path):
    write_ahap(tmp_path / "x.ahap", np.ones(70_000), 1000, sound="x.wav")
    *events, sound = read(tmp_path / "x.ahap")[0]
    spans = [(event["Time"], event["EventDuration"]) for event in events]
    assert spans == [(0.0, 30.0), (30.0, 30.0), (60.0, 10.0)]
    assert (sound["EventType"], sound["EventWaveformPath"]) == ("AudioCustom", "x.wav")


def test_mistakes_are_explained(tmp_path):
    with pytest.raises(InputError, match="full scale"):
        write_ahap(tmp_path / "x.ahap", np.ones(10), 1000, -1.0)
    with pytest.raises(InputError, match="too short"):
        write_ahap(tmp_path / "x.ahap", np.ones(0), 1000)
