"""A model or a recording of another rate is refused, and never played at another pitch."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import mmt
from mmt.core.errors import InputError
from mmt.leader.output.model_output import ModelOutput
from mmt.leader.output.synthesis import SynthesizingPart
from mmt.leader.part import Session
from mmt.scene.files import scene_from_tables
from mmt.texture.model.texture_model import TextureModel


def model_of(rate_hz: float) -> TextureModel:
    shipped = mmt.load_model("oak")
    return TextureModel(shipped.samples, method="published", rate_hz=rate_hz)


@pytest.mark.parametrize("rate_hz", [500.0, 2000.0])
def test_no_way_into_a_session_takes_a_model_of_another_rate(
    rate_hz: float, tmp_path: Path
) -> None:
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
    with pytest.raises(InputError, match=f"{rate_hz:g} Hz, the session of 1000 Hz"):
        SynthesizingPart.build(Session(scene))
    vibration: Any = SimpleNamespace()
    output = ModelOutput(Session(scene), vibration=vibration)
    with pytest.raises(InputError, match="100 Hz on its surface"):
        output.use_shared(model, None)


def test_frames_stamped_at_another_rate_are_refused() -> None:
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
