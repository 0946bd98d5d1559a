"""Sessions through both services, each with a setting of its own."""

import asyncio
import json

import numpy as np
import pytest
from monitor_browser import monitored, open_browser
from monitor_messages import until
from scipy import signal
from service_runs import MadeSource, Together, small_scene

import mmt
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.reports.report import write_report
from mmt.evaluation.run_verdict import run_verdict
from mmt.link.server import LeaderServer
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session

K = 5


@pytest.mark.parametrize("rendering", [None, {"model": "felt", "crossfade_ms": 20.0}])
async def test_the_recorded_output_has_five_samples_a_millisecond(tmp_path, rendering):
    scene = small_scene(
        tmp_path, session={"duration_s": 3.0, "acceleration_rate_hz": 1000 * K}, rendering=rendering
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


SAMPLES = 50 * K
LEARNT_FRAMES = 8000


async def test_a_leader_renders_what_it_has_learnt_where_its_hand_meets_the_surface(tmp_path):
    scene = small_scene(
        tmp_path,
        session={"acceleration_rate_hz": 1000 * K, "seed": 2, "duration_s": 60.0},
        simulated={"surface": "wood", "surface_stiffness_n_mm": 20.0},
        hand={"kind": "taps"},
        texture={"start_share": 0.2, "stop_share": 0.99},
        rendering={"crossfade_ms": 0.0},
        playout=None,
    )
    assert scene.texture is not None
    frames, _ = mmt.simulate_session(scene, duration_s=14.0)
    quick = np.array_split(frames[:LEARNT_FRAMES], LEARNT_FRAMES // 20)
    slow = np.array_split(frames[LEARNT_FRAMES:], len(frames) - LEARNT_FRAMES)
    together = await Together.listening(scene)
    part = together.leader.parts.vibration
    assert part is not None
    begun = []
    played = []
    add = part.switch.touch_down

    def touch_down(approach_speed_mm_s):
        add(approach_speed_mm_s)
        model = together.leader.parts.completing.rendered
        if model is not None and model.touch_down is not None and part.mode == "synthesized":
            at = sum(map(len, played))
            begun.append((at, model.touch_down.response(approach_speed_mm_s)))

    part.switch.touch_down = touch_down
    write = part.actuator.write

    def noted(vibration):
        played.append(vibration.copy())
        write(vibration)

    part.actuator.write = noted
    await together.follow(MadeSource([*quick, *slow]))
    await together.end()
    output = np.concatenate(played)
    alike = [
        np.corrcoef(output[at : at + SAMPLES], response)[0, 1]
        for at, response in begun
        if at + SAMPLES <= len(output)
    ]
    assert max(alike) > 0.95  # of a touch that does not slide there is nothing else


def scene_with(directory, method, **tables):
    feedback = {"method": method}
    return small_scene(
        directory,
        force_feedback=feedback,
        playout=None,
        actuator=None,
        recording=None,
        session={"duration_s": 2.5},
        **tables,
    )


@pytest.mark.parametrize("profile", [None, "wan"])
async def test_passive_tells_the_energies_on_both_sides(tmp_path, profile):
    network = {} if profile is None else {"network": {"profile": profile}}
    together = await Together.listening(scene_with(tmp_path, "passive", **network))
    followed = await together.follow()
    led = await together.end()
    assert led.problem is None
    assert led.feedback["method"] == followed.feedback["method"] == "passive"
    assert led.feedback["energy_in_mj"] > 0.0
    assert followed.feedback["energy_out_mj"] > 0.0
    assert 0.0 < followed.feedback["energy_given_mj"] <= led.feedback["energy_in_mj"]
    assert led.feedback["energy_given_mj"] <= followed.feedback["energy_in_mj"] + 1e-3
    injected = led.feedback["energy_injected_mj"]
    assert injected <= 1.0 + led.feedback["energy_overdrawn_mj"] + 1e-3


async def test_the_model_is_estimated_from_what_the_follower_tells(tmp_path):
    together = await Together.listening(scene_with(tmp_path, "model", network={"profile": "wan"}))
    followed = await together.follow()
    led = await together.end()
    assert led.problem is None
    assert followed.feedback["samples"] > 1000
    assert led.feedback["contacts"] >= 1
    # the simulated surface of 5 N/mm; ticks may be missed on a machine that is busy
    assert 2.0 < led.feedback["surface"]["stiffness_n_mm"] < 10.0
    assert led.feedback["felt"]["stiffness_n_mm"] < led.feedback["surface"]["stiffness_n_mm"]


THROUGHOUT = "the accelerometer gave one value throughout"


async def test_a_dead_accelerometer_starts_no_model_and_is_named(tmp_path):
    frames, _ = simulate_session(Scene(), "plastic", 6.0)
    frames = frames.copy()
    frames["acceleration_m_s2"] = 9.81
    session = tmp_path / "dead.npz"
    write_session(session, frames)
    together = await monitored(
        tmp_path,
        simulated=None,
        hand=None,
        replay={"file": str(session), "speed": 2.0},
        texture={"order": 10},
    )
    async with open_browser() as browser:
        socket = await browser.look_on(together)
        following = asyncio.create_task(together.follow())
        while not (shown := await until(socket, "completion"))["faults"]:
            assert shown["start_s"] is None
    await following
    assert shown["faults"].startswith(THROUGHOUT)  # a busy machine may lose frames besides
    summary = await together.end()
    told = [sentence for sentence in together.said if THROUGHOUT in sentence]
    assert len(told) == 1
    assert told[0].startswith(f"not measured: {THROUGHOUT}")
    faults = summary.texture["faults"]
    assert faults["text"].startswith(THROUGHOUT)
    assert faults["constant_s"] > 0.5
    assert summary.texture["start_s"] is None
    found = run_verdict({"leader": summary.as_dict()})
    assert f"leader: not measured: {faults['text']}" in found.faults


FIELD = {"method": "field", "start_share": 0.5, "stop_share": 0.9}


async def test_a_session_starts_and_stops_by_the_expected_share(tmp_path):
    frames, annotations = simulate_session(Scene(), "fabric", 7.0, 4)
    session = tmp_path / "strokes.npz"
    write_session(session, frames, annotations=annotations)
    recording = tmp_path / "session.mcap"
    scene = small_scene(
        tmp_path,
        simulated=None,
        hand=None,
        replay={"file": str(session), "speed": 2.0},
        texture=FIELD,
        recording={"file": str(recording)},
    )
    together = await Together.listening(scene)
    await together.follow()
    summary = await together.end()

    said = summary.texture["completion"]
    assert said["criterion"] == "uncertainty"
    assert 0.9 <= said["value"] <= 1.0
    assert summary.texture["start_s"] <= summary.texture["stop_s"] < 7.0
    status = together.leader.status()
    assert status.completion == str(together.leader.log.update.progress)
    assert any("stop criterion met" in line for line in together.said)

    found = read_session(recording)
    recorded = scene_from_tables(dict(found.scene or {}), origin="recorded").texture
    evaluation = evaluate_session(found, recorded.settings())
    assert evaluation.stop_s is not None
    assert evaluation.at_stop.completion >= 0.9
    write_report(tmp_path / "report", [evaluation])
    text = (tmp_path / "report" / "report.md").read_text()
    assert "xpected share" in text
    assert "share of the operator's strokes" in text
    steps = json.loads((tmp_path / "report" / "summary.json").read_text())["steps"]
    assert all(0.0 <= step["completion"] <= 1.0 for step in steps)


@pytest.mark.parametrize("on_silence", ["hold", "retract"])
async def test_the_robot_holds_or_retracts_and_takes_the_commands_up_again(
    tmp_path, monkeypatch, on_silence
):
    silent = False
    send = LeaderServer.send_commands

    def stifled(self, commands):
        if not silent:
            send(self, commands)

    monkeypatch.setattr(LeaderServer, "send_commands", stifled)
    link = {"port": 0, "patience_s": 5.0, "on_silence": on_silence, "retract_mm": 20.0}
    together = await Together.listening(
        small_scene(tmp_path, link=link, session={"duration_s": 3600.0})
    )
    follower = together.follower()
    following = asyncio.create_task(follower.run())
    await together.until(lambda: together.leader.time_s > 0.7)
    silent = True
    does = "holding" if on_silence == "hold" else "retracting"
    said = f"follower: leader silent for 0.1 s: {does}"
    await together.until(lambda: said in together.said)
    silent_from = together.leader.time_s
    await together.until(lambda: together.leader.time_s > silent_from + 0.8)
    silent = False
    await together.until(lambda: any("leader is back" in sentence for sentence in together.said))
    heard_from = together.leader.time_s
    await together.until(lambda: together.leader.time_s > heard_from + 0.3)
    await together.stop()
    summary = await following
    assert summary.commands["silences"] >= 1
    assert summary.commands["silent_s"] >= 0.7
    session = read_session(tmp_path / "session.mcap")
    recorded = [event["event"] for event in session.events]
    assert said in recorded
    assert any("leader is back" in event and event.endswith("mm/s") for event in recorded), recorded
    frames = session.frames
    held = frames[round(1000 * silent_from) + 600 : round(1000 * silent_from) + 750]
    spread_mm = np.ptp(held["position_mm"], axis=0)
    assert (spread_mm < 1.0).all()  # at rest but for the sensor's noise
    if on_silence == "retract":
        assert held["position_mm"][:, 2].min() > 15.0
