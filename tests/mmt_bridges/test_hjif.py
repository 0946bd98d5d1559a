"""MPEG haptics files: read by a decoder of our own, and by the reference software where it is."""

import datetime
import os
import subprocess

import numpy as np
import pytest
from scipy.io import wavfile
from wavelet_decoder import analysis, decode

from mmt.core.errors import InputError
from mmt.models import find_model, shipped_models
from mmt.texture.model.texture_model import TextureModel
from mmt_bridges.haptics.effects import effect, write_wav
from mmt_bridges.haptics.hjif import transform, write_hjif

SYNTHESIZER = "MMT_HJIF_SYNTHESIZER"
"""Environment variable with the path of the reference software's Synthesizer."""


def stroke(name, rate_hz, seconds):
    count = round(100 * seconds)
    velocity_mm_s = np.tile([120.0, 0.0], (count, 1))
    model = TextureModel.load(find_model(name))
    return effect(
        model, velocity_mm_s, np.full(count, 1.0), motion_hz=100.0, output_hz=rate_hz, seed=2
    )


def relative_error(decoded, samples):
    return float(np.sqrt(np.mean((decoded - samples) ** 2) / np.mean(samples**2)))


@pytest.mark.parametrize("count", [16, 128, 1024])
def test_the_transform_is_the_linear_map_of_its_filters(count):
    blocks = np.random.default_rng(1).standard_normal((3, count))
    np.testing.assert_allclose(transform(blocks), blocks @ analysis(count).T, atol=1e-12)


@pytest.mark.parametrize("rate_hz", [1000, 2000, 4000, 8000])
def test_vibration_comes_back_within_the_rounding_of_sound(rate_hz, tmp_path):
    samples = stroke("oak", rate_hz, 0.7)
    written = write_hjif(tmp_path / "oak.hjif", samples, rate_hz, description="oak")
    decoded, document = decode(tmp_path / "oak.hjif")
    assert written == (len(samples) / rate_hz, np.abs(samples).max())
    assert len(decoded) == len(samples)
    assert relative_error(decoded * written.full_scale_m_s2, samples) < 4e-4
    (perception,) = document["perceptions"]
    (device,) = perception["reference_devices"]
    assert device["maximum_amplitude"] == written.full_scale_m_s2
    assert perception["perception_modality"] == "Vibrotactile"
    assert (document["version"], document["profile"], document["level"]) == ("2023", "Main", 1)
    assert datetime.datetime.fromisoformat(document["date"]).tzinfo is not None


N = np.arange(300)
SHAPES = {
    "silence": 0.0 * N,
    "offset": np.ones(300),
    "impulse": np.where(N == 131, -1.0, 0.0),
    "alternating": (-1.0) ** N,
    "tiny": 1e-9 * np.sin(N),
    "pause": np.where(N < 100, np.sin(N), 0.0),
    "noise": np.random.default_rng(3).uniform(-1.0, 1.0, 300),
    "one": np.ones(1),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_extreme_waveforms_come_back(shape, tmp_path):
    samples = SHAPES[shape]
    full_scale = write_hjif(tmp_path / "x.hjif", samples, 1000).full_scale_m_s2
    decoded, _ = decode(tmp_path / "x.hjif")
    assert len(decoded) == len(samples)
    np.testing.assert_allclose(decoded, samples / full_scale, atol=1.5e-3)
    if shape == "silence":
        assert full_scale == 1.0
        assert not decoded.any()
    else:
        assert relative_error(decoded, samples / full_scale) < 3e-4
        write_hjif(tmp_path / "x.hjif", samples, 1000, full_scale / 2)  # beyond which is clipped
        decoded, _ = decode(tmp_path / "x.hjif")
        np.testing.assert_allclose(decoded, np.clip(2 * samples / full_scale, -1, 1), atol=5e-4)


@pytest.mark.parametrize(
    ("rate_hz", "count", "full_scale", "message"),
    [
        (44_100, 10, None, "can have 1000, 2000, 4000, 8000"),
        (1000, 0, None, "too short"),
        (1000, 10, 0.0, "full scale"),
    ],
)
def test_mistakes_are_explained(rate_hz, count, full_scale, message, tmp_path):
    with pytest.raises(InputError, match=message):
        write_hjif(tmp_path / "x.hjif", np.ones(count), rate_hz, full_scale)
    assert not (tmp_path / "x.hjif").exists()


@pytest.mark.skipif(SYNTHESIZER not in os.environ, reason=f"{SYNTHESIZER} names no program")
@pytest.mark.parametrize("name", shipped_models())
def test_the_reference_software_plays_each_shipped_model(name, tmp_path):
    rate_hz = 8000
    samples = stroke(name, rate_hz, 2.0)
    full_scale = write_hjif(tmp_path / "x.hjif", samples, rate_hz).full_scale_m_s2
    write_wav(tmp_path / "x.wav", samples, rate_hz)
    command = [os.environ[SYNTHESIZER], "-f", "x.hjif", "-o", "played.wav", "-fs", "16000"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=60)
    played = wavfile.read(tmp_path / "played.wav")[1][1::2] / 32768.0
    # It repeats samples; of two, the second is clear of its rounding of the sample's number.
    assert relative_error(played, samples / full_scale) < 4e-4
    sound = wavfile.read(tmp_path / "x.wav")[1] / 32767.0
    assert relative_error(played, sound) < 4e-4
