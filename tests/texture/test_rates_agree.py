"""A model of another rate is resampled and a recording of one refused: no pitch is changed."""

import dataclasses

import numpy as np
import pytest

import mmt
from mmt.core.errors import InputError
from mmt.leader.output.model_output import ModelOutput
from mmt.leader.output.synthesis import SynthesizingPart
from mmt.leader.part import Session
from mmt.scene.files import scene_from_tables
from mmt.texture.model.texture_model import TextureModel


def model_of(rate_hz):
    shipped = mmt.load_model("oak")
    return TextureModel(shipped.samples, method="published", rate_hz=rate_hz)


@pytest.mark.parametrize("rate_hz", [500.0, 2000.0])
async def test_every_way_into_a_session_resamples_a_model_of_another_rate(rate_hz, tmp_path):
    model = model_of(rate_hz)
    file = tmp_path / "other.npz"
    model.save(file)
    scene = scene_from_tables(
        {
            "hand": {},
            "link": {},
            "simulated": {},
            "texture": {},
            "actuator": {},
            "rendering": {"model": str(file)},
        }
    )
    told = []
    session = Session(scene, told.append)
    saved, shared = SynthesizingPart.build(session), SynthesizingPart.build(session)
    assert saved is not None
    shared.synthesizer.model = None
    ModelOutput(session, synthesizing=saved).begin()
    await ModelOutput(session, synthesizing=shared).use_shared(model, None)
    what = "nothing above 250 Hz is in it" if rate_hz < 1000 else "what is above 500 Hz is left out"
    assert told == [f"the model is of {rate_hz:g} Hz and is played at 1000 Hz: {what}"] * 2
    below_hz = np.arange(20.0, 0.4 * min(rate_hz, 1000.0))
    wanted = model.spectrum(120.0, 1.0, frequencies_hz=below_hz)
    for part in (saved, shared):
        assert part.synthesizer.model.rate_hz == 1000.0
        played = part.synthesizer.model.spectrum(120.0, 1.0, frequencies_hz=below_hz)
        assert np.sqrt(np.mean((10.0 * np.log10(played / wanted)) ** 2)) < 2.0


def test_frames_stamped_at_another_rate_are_refused():
    frames, truth = mmt.simulate_session(mmt.Scene(), surface="wood", duration_s=3.0)
    mmt.build_model(frames)
    slow = frames.copy()
    slow["time_ns"] = slow["time_ns"][0] + 2 * (frames["time_ns"] - frames["time_ns"][0])
    settings = dataclasses.replace(mmt.ModellingSettings())
    for use in (
        lambda: mmt.build_model(slow, settings),
        lambda: mmt.evaluate_session(mmt.RecordedSession(slow, annotations=truth)),
    ):
        with pytest.raises(InputError, match="500 Hz"):
            use()
    jittered = frames.copy()
    jitter_ns = np.random.default_rng(1).integers(-400_000, 400_000, len(frames))
    jittered["time_ns"] += jitter_ns
    mmt.build_model(jittered)
