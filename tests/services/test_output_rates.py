"""A session whose vibration is of several kHz, from a simulated sensor to the recorded output."""

import numpy as np
import pytest
from scipy import signal
from service_runs import Together, small_scene

import mmt

K = 5


@pytest.mark.parametrize("rendering", [None, {"model": "felt", "crossfade_ms": 20.0}])
async def test_the_recorded_output_has_five_samples_a_millisecond(tmp_path, rendering):
    scene = small_scene(
        tmp_path,
        session={"duration_s": 3.0, "acceleration_rate_hz": 1000 * K},
        rendering=rendering,
    )
    together = await Together.listening(scene)
    await together.follow()
    summary = await together.end()
    session = mmt.read_session(tmp_path / "session.mcap")
    assert session.samples_per_frame == K
    assert {output.rate_hz for output in session.outputs} == {1000.0 * K}
    played = np.concatenate([output.vibration_m_s2 for output in session.outputs])
    begin_s, end_s = session.outputs[0].time_s, session.outputs[-1].end_s
    assert len(played) == pytest.approx(1000 * K * (end_s - begin_s), rel=0.05)
    assert summary.vibration["actuator"]["samples"] == len(played)
    frequencies, power = signal.welch(played, 1000.0 * K, nperseg=1000)
    if rendering is None:
        measured = session.frames["acceleration_m_s2"].reshape(-1, 3)[:, 2]
        _, wanted = signal.welch(measured, 1000.0 * K, nperseg=1000)
        band = frequencies > 20.0
        assert 0.7 < power[band].sum() / wanted[band].sum() < 1.3
    else:
        high = frequencies > 600.0
        assert power[high].sum() < 0.05 * power.sum()
        assert any("is of 1000 Hz and is played at 5000 Hz" in said for said in together.said)
