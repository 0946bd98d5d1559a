"""Strokes on the page, recorded with as many samples a frame as the model's rate asks for."""

import numpy as np
import pytest

import mmt
from mmt.texture.model.texture_model import TextureModel
from mmt_share.player.messages import Step
from mmt_share.player.recording import TouchRecorder


@pytest.mark.parametrize("k", [1, 3])
def test_a_touch_is_recorded_at_the_rate_of_its_model(tmp_path, k):
    shipped = mmt.load_model("oak")
    model = TextureModel(shipped.samples, method="published", rate_hz=1000.0 * k)
    recorder = TouchRecorder(tmp_path / "touch.mcap", ["oak"], [model])
    recorder.record(0, [Step(10, (0.0, 0.0), (150.0, 0.0), 1.0)] * 50)
    assert recorder.problem is None
    ((file, seconds),) = recorder.close()
    session = mmt.read_session(file)
    assert seconds == pytest.approx(0.5)
    assert len(session.frames) == 500
    assert session.samples_per_frame == k
    along = session.frames["acceleration_m_s2"].reshape(-1, 3)[:, 2]
    assert len(along) == 500 * k
    density = np.abs(np.fft.rfft(along)) ** 2
    above = np.fft.rfftfreq(len(along), 1e-3 / k) > 500.0
    assert (density[above].sum() > 0.1 * density.sum()) == (k > 1)
