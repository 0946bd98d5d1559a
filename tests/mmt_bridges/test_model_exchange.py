"""`mmt model import` and `export`: what they write, and what they say of mistakes."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_runs import output_of, refusal, run_json
from scipy.io import wavfile
from wavelet_decoder import decode

from mmt.scene import Scene
from mmt.session.files import write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.model.texture_model import TextureModel

MODEL = Path("configs/models/plastic.npz")


def export(*arguments):
    return output_of("model", "export", *arguments)


def test_a_model_goes_out_as_xml_and_comes_back(tmp_path):
    files = (tmp_path / "plastic.xml", tmp_path / "back.npz")
    export(MODEL, files[0], "--friction", 0.3)
    figures, _ = run_json(tmp_path, "model", "import", *files)
    assert (figures["material"], figures["friction"]) == ("plastic", 0.3)
    assert figures["same_triangles"] == 1.0
    before, after = TextureModel.load(MODEL), TextureModel.load(files[1])
    at = before.samples.speed_mm_s, before.samples.force_n
    np.testing.assert_allclose(after.at(*at)[0], before.at(*at)[0], rtol=1e-9)
    np.testing.assert_allclose(after.at(*at)[1], before.at(*at)[1], rtol=1e-9)


def test_models_go_out_as_a_page_and_one_as_json(tmp_path):
    page, alone = tmp_path / "two.html", tmp_path / "plastic.json"
    export(MODEL, "felt", page)
    export(MODEL, alone)
    form = alone.read_text()
    assert json.loads(form)["name"] == "plastic"
    assert form in page.read_text()
    refusal("model", "export", "oak", page)


def test_a_steady_stroke_or_a_recorded_motion_becomes_sound(tmp_path):
    path = tmp_path / "stroke.wav"
    arguments = ("--speed", 150, "--seconds", 2, "--rate", 8000, "--full-scale", 20)
    export(MODEL, path, *arguments)
    rate, samples = wavfile.read(path)
    assert (rate, samples.dtype, len(samples)) == (8000, np.int16, 16_000)
    model = TextureModel.load(MODEL)
    power = np.trapezoid(model.spectrum(150.0, 1.0, frequencies_hz=np.arange(1.0, 499.0)), dx=1.0)
    assert np.std(samples / 32767.0 * 20.0) == pytest.approx(np.sqrt(power), rel=0.1)
    frames, annotations = simulate_session(Scene(), "wood", 2.0, 3)
    write_session(tmp_path / "wood.npz", frames, annotations=annotations)
    export(MODEL, path, "--motion", tmp_path / "wood.npz", "--rate", 2000, "--force")
    assert len(wavfile.read(path)[1]) == pytest.approx(4000, abs=50)


def test_a_stroke_becomes_haptics_of_the_same_vibration(tmp_path):
    for name in ("stroke.hjif", "stroke.wav"):
        arguments = ("--speed", 150, "--seconds", 0.5, "--rate", 2000, "--full-scale", 20)
        export("oak", tmp_path / name, *arguments)
    decoded, document = decode(tmp_path / "stroke.hjif")
    _, sound = wavfile.read(tmp_path / "stroke.wav")
    np.testing.assert_allclose(decoded, sound / 32767.0, atol=2e-4)
    assert document["description"] == "oak"
    assert "0.20 s at 8000 Hz" in export(MODEL, tmp_path / "own.hjif", "--seconds", 0.2)


def test_a_stroke_becomes_a_pattern_with_its_sound(tmp_path):
    path = tmp_path / "stroke.ahap"
    export(MODEL, path, "--seconds", 0.5, "--with-sound")
    events = [each["Event"] for each in json.loads(path.read_text())["Pattern"] if "Event" in each]
    assert [event.get("EventWaveformPath") for event in events] == [None, "stroke.wav"]
    assert len(wavfile.read(tmp_path / "stroke.wav")[1]) == 22_050
    path.unlink()
    assert "stroke.wav" in refusal("model", "export", MODEL, path, "--with-sound")
    assert not path.exists()
    export(MODEL, path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("export", MODEL, "out.mp3"), "must end in .html, .json, .xml, .wav, .hjif or .ahap"),
        (("export", MODEL, "out.wav", "--full-scale", "-1"), "full scale"),
        (("export", "none.npz", "out.wav"), "No such file"),
        (("export", MODEL, "out.hjif", "--rate", "44100"), "can have 1000, 2000"),
        (("export", MODEL, "out.wav", "--with-sound"), "--with-sound is for .ahap"),
        (("export", MODEL, "out.ahap", "--friction", 0.3), "--friction is for .xml, not "),
        (("export", MODEL, "out.xml", "--normal-force", 1), "--normal-force is for vibration"),
        (("export", MODEL, "out.xml", "--seed", 0), "--seed is for vibration"),
        (
            ("export", MODEL, "out.wav", "--motion", "a.mcap", "--speed", 100),
            "--speed does not go with --motion",
        ),
        (("export", MODEL, "/proc/none/out.ahap"), "cannot write /proc/none/out.ahap"),
        (("import", MODEL, "out.npz"), "no XML"),
        (("import", MODEL, "out.xml"), "must end in .npz"),
        (("export", MODEL, MODEL, "out.wav"), "takes one model, not 2; a page (.html) several"),
        (("export", MODEL, "out.html", "--seed", "1"), "--seed is for vibration"),
        (("export", MODEL, "/proc/none/out.wav"), "cannot write /proc/none/out.wav"),
    ],
)
def test_mistakes_are_explained(arguments, message, tmp_path):
    given = [tmp_path / name if str(name).startswith("out.") else name for name in arguments]
    assert message in refusal("model", *given)
