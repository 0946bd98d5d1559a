"""Both services as processes, end to end, on loopback."""

import json
import re
import signal
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from service_processes import Service, follower_of, scene, session, streamed_s

from mmt.session.files import read_session, write_session

DURATION_S = 12.0  # on a loaded machine the second follower takes seconds to start
REPLAYED = 1500
_ADDRESS = re.compile(r"ready after [\d.]+ s: (127\.0\.0\.1:\d+)")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One session and what tried to disturb it."""
    directory = tmp_path_factory.mktemp("run")
    arguments = ("--record", "session.mcap", "--duration", DURATION_S)
    surface = {"MMT_SIMULATED__SURFACE": "plastic"}
    with session(directory, "demo", *arguments, **surface) as (leader, follower):
        port = leader.port()
        leader.wait_for(lambda: streamed_s(leader) > 0.0)  # else the second may be the first
        with (
            follower_of(leader, "demo", directory) as second_follower,
            Service(
                "leader", scene("stream-only"), "--port", port, *arguments, cwd=directory
            ) as second_leader,
        ):
            second_follower.end()
            second_leader.end()
            codes = (leader.end(), follower.end())
            yield SimpleNamespace(
                leader=leader,
                follower=follower,
                second_follower=second_follower,
                second_leader=second_leader,
                codes=codes,
                recording=read_session(directory / "session.mcap"),
            )


def test_both_end_well_and_say_how(run):
    assert run.codes == (0, 0), run.leader.stderr + run.follower.stderr
    assert run.leader.summary()["outcome"] == "completed"
    assert run.follower.summary()["outcome"] == "leader stopped (completed)"
    assert run.follower.stderr == ""
    said = run.follower.events()
    looking = next(at for at, event in enumerate(said) if "looking for the leader" in event)
    assert "connected to the leader" in said[looking + 1 :]
    assert "refused a follower: another follower is connected" in run.leader.stderr
    assert run.leader.stderr.count("\n") == 1


def test_every_frame_is_received_and_recorded(run):
    sent, link = run.follower.summary()["link"]["frames"], run.leader.summary()["link"]
    frames = run.recording.frames
    if not link["lost"]:  # a busy machine may hold up the link until it is given up for a while
        assert link["frames"] == sent
    assert (link["out_of_order"], link["repeated"], link["rejected"]) == (0, 0, {})
    assert len(frames) == link["frames"] + link["lost"] >= DURATION_S * 1000  # those filled in
    np.testing.assert_array_equal(frames["sequence"], np.arange(len(frames)))
    np.testing.assert_array_equal(np.diff(frames["time_ns"]), 1_000_000)
    assert run.leader.summary()["recording"] == {
        "file": "session.mcap",
        "frames": len(frames),
        "dropped": 0,
        "error": None,
    }


def test_commands_come_down_and_are_followed(run):
    commands = run.leader.summary()["link"]["commands"]
    received = run.follower.summary()["link"]
    made_up = run.leader.summary()["ticks"]["missed"]  # share one command with a later tick
    assert commands > 0.9 * received["frames"] - made_up
    assert received["commands"] + received["lost"] >= 0.9 * commands
    height_mm = run.recording.frames["position_mm"][:, 2]
    assert height_mm[0] > 0.0 > height_mm.min()


def test_the_vibration_switches_to_the_model_at_the_start_criterion(run):
    texture, vibration = run.leader.summary()["texture"], run.leader.summary()["vibration"]
    assert texture["samples"] >= 3  # a triangle
    assert 0.0 < texture["start_s"] < DURATION_S
    *before, last = [switch["mode"] for switch in vibration["switches"]]
    assert last == "synthesized"
    assert before in ([], ["fading"])  # on a busy machine a stall may be longer than the fade
    assert vibration["switches"][0]["time_s"] >= texture["start_s"]
    modes = [output.mode for output in run.recording.outputs]
    assert modes[0] == "streamed"
    assert modes[-1] == "synthesized"
    assert vibration["actuator"]["rms_m_s2"] > 0.1
    statuses = run.leader.lines("status")
    times_s = [status["time_s"] for status in statuses]
    assert len(statuses) > 2 * DURATION_S
    assert times_s == sorted(times_s)
    assert statuses[-1]["mode"] == "synthesized"


def test_the_recording_holds_scene_truth_models_and_events(run):
    recording = run.recording
    assert recording.complete
    assert recording.scene["session"]["duration_s"] == DURATION_S
    assert json.loads(recording.annotations)["surface"] == "plastic"
    start_s = run.leader.summary()["texture"]["start_s"]
    assert recording.models[0][0] == pytest.approx(start_s, abs=1e-3)
    for _, model in recording.models:
        assert len(np.load(BytesIO(model))["speed_mm_s"]) >= 1
    sentences = [event["event"] for event in recording.events]
    assert "follower connected (simulated)" in sentences
    assert f"start criterion met at {start_s:.1f} s" in sentences


def test_a_second_follower_is_refused_while_the_first_goes_on(run):
    assert run.second_follower.end() == 1
    assert run.second_follower.stderr.count("another follower is connected") == 1
    assert "Traceback" not in run.second_follower.stderr
    events = [each.split(" (")[0] for each in run.leader.events()]
    assert events.count("follower connected") == 1 + events.count("follower lost")


def test_a_second_leader_on_the_port_leaves_the_recording_alone(run):
    assert run.second_leader.end() == 1
    assert run.second_leader.stderr.count("cannot listen on 127.0.0.1 port") == 1
    assert "(Address already in use)" in run.second_leader.stderr
    assert "Traceback" not in run.second_leader.stderr
    assert len(run.recording.frames) >= DURATION_S * 1000


@pytest.fixture(scope="module")
def replayed(run, tmp_path_factory):
    """The first seconds of the session again, in the form for people."""
    directory = tmp_path_factory.mktemp("replayed")
    original = run.recording
    write_session(
        directory / "part.mcap", original.frames[:REPLAYED], annotations=original.annotations
    )
    common = ("--replay", "part.mcap")
    leader_arguments = (*common, "--port", 0, "--json", "leader.json", "--record", "session.mcap")
    with Service("leader", scene("demo"), *leader_arguments, cwd=directory) as leader:
        leader.wait_for(lambda: _ADDRESS.search(leader.stderr))
        address = _ADDRESS.search(leader.stderr)
        with Service(
            "follower",
            scene("demo"),
            *common,
            "--leader",
            f"http://{address[1]}",
            "--json",
            "follower.json",
            cwd=directory,
        ) as follower:
            codes = (leader.end(), follower.end())
            recording = read_session(directory / "session.mcap")
            yield SimpleNamespace(
                leader=leader,
                follower=follower,
                codes=codes,
                recording=recording,
                directory=directory,
            )


def test_a_replayed_session_arrives_as_it_was_recorded(run, replayed):
    assert replayed.codes == (0, 0), replayed.leader.stderr + replayed.follower.stderr
    original, again = run.recording, replayed.recording
    assert again.annotations == original.annotations
    for name in ("sequence", "position_mm", "force_n", "acceleration_m_s2"):
        np.testing.assert_array_equal(again.frames[name], original.frames[name][:REPLAYED])
    np.testing.assert_array_equal(np.diff(again.frames["time_ns"]), 1_000_000)
    led, followed = (
        json.loads((replayed.directory / f"{name}.json").read_text())
        for name in ("leader", "follower")
    )
    assert (led["outcome"], led["link"]["lost"]) == ("source ended", 0)
    assert followed["link"]["frames"] == REPLAYED
    assert REPLAYED - 100 < followed["ticks"]["ticks"] < 2 * REPLAYED, "as long as the session did"
    for name, service in (("leader", replayed.leader), ("follower", replayed.follower)):
        assert service.stdout.startswith(f"mmt-{name}  ")
        assert len(service.stdout.splitlines()) < 12
        assert "drift ppm" not in service.stdout


def model_only(directory, option):
    """A leader without a follower, that has ended."""
    model = Path(scene("demo")).parent / "models/plastic.npz"
    arguments = (scene("model-only"), option, "--duration", 1, "--model", model)
    with Service("leader", *arguments, cwd=directory) as leader:
        assert leader.end() == 0, leader.stderr
    return leader


def test_verbose_shows_every_counter(tmp_path):
    leader = model_only(tmp_path, "--verbose")
    assert "late share 1ms" in leader.stdout
    assert "mmt-leader  1.0 s" in leader.stdout
    assert "runs:     hand, rendering, actuator" in leader.stderr
    assert "left out: link, network" in leader.stderr


def test_a_scene_without_a_follower(tmp_path):
    leader = model_only(tmp_path, "--json-lines")
    summary = leader.summary()
    assert summary["outcome"] == "completed"
    assert summary["vibration"]["mode"] == "synthesized"
    assert summary["vibration"]["actuator"]["samples"] >= 1000
    assert "link" not in summary
    assert leader.lines("ready")[0]["port"] is None


def test_the_demo_leaves_a_recording_and_a_report(tmp_path):
    with Service("main", "demo", "--duration", 1, "--json", "all.json", cwd=tmp_path) as service:
        assert service.end() == 0, service.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"mmt-demo", "all.json"}
    recording = read_session(tmp_path / "mmt-demo" / "session.mcap")
    assert recording.complete
    assert len(recording.frames) >= 1000
    assert "<html" in (tmp_path / "mmt-demo" / "report.html").read_text()
    content = json.loads((tmp_path / "all.json").read_text())
    assert content["leader"]["outcome"] == "completed"
    assert content["follower"]["link"]["frames"] == len(recording.frames)
    assert content["evaluation"]
    assert "mmt session view mmt-demo/session.mcap" in service.stdout
    assert "drift ppm" not in service.stdout


def test_both_services_log_one_session_and_their_token_is_written_nowhere(tmp_path):
    token = "a secret of this test alone"
    with session(
        tmp_path,
        "stream-only",
        *("--log", "leader.jsonl", "--log-level", "debug"),
        follower_arguments=("--log", "follower.jsonl"),
        MMT_RECORDING__FILE="session.mcap",
        MMT_LINK_TOKEN=token,
    ) as (leader, follower):
        with follower_of(leader, "stream-only", tmp_path, MMT_LINK_TOKEN="x" * 16) as stranger:
            assert stranger.end() == 1
        assert "refused: the token is missing or wrong" in stranger.stderr
        leader.signal(signal.SIGTERM)
        assert (leader.end(), follower.end()) == (0, 0), leader.stderr + follower.stderr
    summary, identity = leader.summary(), leader.summary()["session"]["id"]
    assert summary["link"]["frames"] == follower.summary()["link"]["frames"] > 0
    assert summary["vibration"]["mode"] == "streamed"
    assert "texture" not in summary
    recording = read_session(tmp_path / "session.mcap")
    assert re.fullmatch("[0-9a-f]{12}", identity)
    assert follower.summary()["session"]["id"] == recording.session_id == identity
    events = []
    for name in ("leader", "follower"):
        text = (tmp_path / f"{name}.jsonl").read_text(encoding="utf-8")
        lines = [json.loads(line) for line in text.splitlines()]
        events += [line["event"] for line in lines]
        assert {line["service"] for line in lines} == {name}
        assert lines[0]["event"] == "started"
        assert lines[0]["scene"]["session"]["name"]
        assert lines[-1]["event"] == "summary"
        assert lines[-1]["summary"]["outcome"]
        assert {line["session"] for line in lines if line["event"] != "started"} >= {identity}
        assert lines[-1]["session"] == identity
    assert {"follower connected (simulated)", "status"} <= set(events)
    outputs = (leader.stdout, leader.stderr, follower.stdout, follower.stderr)
    assert not any(token in output for output in outputs)
    assert not any(token.encode() in file.read_bytes() for file in tmp_path.iterdir())
    assert "token" not in recording.scene["link"]
