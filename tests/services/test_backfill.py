"""What an outage kept back is filled in: the model and the recording are those without it."""

import asyncio
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from service_processes import Service
from service_runs import Together
from wire_relay import Wire

from mmt.core.sequence_numbers import SEQUENCES
from mmt.follower.service import Follower, FollowerSummary
from mmt.leader.reports import LeaderSummary
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session.data import RecordedSession
from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.online.history import build_model

SPEED = 2.0
"""Session time runs so many times faster, to save time."""

TEXTURES = {
    "field": {"method": "field", "start_share": 0.1, "stop_share": 0.9999},
    "published": {"method": "published"},
}
"""Models that are started within the session and not finished."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A simulated session of 7.6 s: its last update is over half a second before its end."""
    frames, annotations = simulate_session(Scene(), "plastic", 7.6, 3)
    file = tmp_path_factory.mktemp("made") / "made.mcap"
    write_session(file, frames, annotations=annotations)
    return file


@dataclass
class Outcome:
    leader: LeaderSummary
    follower: FollowerSummary
    recording: RecordedSession
    said: list[str]

    @property
    def models(self) -> list[tuple[float, bytes]]:
        """What was modelled live: at the start criterion and at the end, as model files."""
        assert len(self.recording.models) > 1
        return list(self.recording.models)


def replaying(made, method="field", **tables):
    session, replay = {"duration_s": 60.0}, {"file": str(made), "speed": SPEED}
    texture = TEXTURES[method]
    return scene_from_tables({"session": session, "replay": replay, "texture": texture, **tables})


def offline(frames, method="field"):
    """The model as `mmt.build_model` gives it."""
    texture = replaying(Path("made.mcap"), method, link={}).texture
    return build_model(frames, texture.settings())


def models_of(history, live):
    """The models at the times of those that were made live, as model files."""
    found = [(time_s, history.model_at(time_s)) for time_s, _ in live.models]
    return [(time_s, model.to_bytes()) for time_s, model in found if model is not None]


async def run(made, directory, outage, network=None, method="field", **link):
    """Run the session over the real link, with an outage of 1.5 s of session time or none."""
    directory.mkdir()
    scene = replaying(
        made,
        method,
        link={"port": 0, "patience_s": 10.0, **link},
        rendering={},
        playout={},
        actuator={},
        recording={"file": str(directory / "session.mcap")},
        **({"network": network} if network is not None else {}),
    )
    together = await Together.listening(scene)
    async with Wire(together.leader.port or 0) as wire:
        follower = Follower(scene, f"http://127.0.0.1:{wire.port}")
        following = asyncio.create_task(follower.run())
        if outage is not None:
            await together.until(lambda: together.leader.time_s > 2.2)
            wire.keep_down() if outage == "cut" else wire.stall()
            await asyncio.sleep(1.5 / SPEED)
            wire.mend()
        followed = await following
        led = await together.end()
    return Outcome(led, followed, read_session(directory / "session.mcap"), together.said)


async def test_the_model_after_an_outage_equals_the_one_without_it(made, tmp_path):
    whole, cut = await asyncio.gather(
        run(made, tmp_path / "whole", None), run(made, tmp_path / "cut", "cut")
    )
    assert whole.leader.link["lost"] == 0
    assert whole.leader.backfill == {}
    assert cut.leader.link["lost"] > 700
    assert cut.leader.backfill["filled"] == cut.leader.backfill["missing"] > 700
    assert cut.leader.backfill["lost"] == cut.leader.backfill["waiting"] == 0
    assert cut.leader.texture["late_frames"] == 0
    assert cut.leader.texture["updates"] == whole.leader.texture["updates"] == 7
    expected = read_session(made).frames
    assert whole.models == cut.models == models_of(offline(expected), whole)
    for recording in (whole.recording, cut.recording):
        for name in ("sequence", "position_mm", "force_n", "acceleration_m_s2"):
            np.testing.assert_array_equal(recording.frames[name], expected[name])
        assert (np.diff(recording.frames["time_ns"]) == 1_000_000).all()
    told = [event for event in cut.recording.events if "kind" in event]
    assert (told[0]["kind"], told[-1]["kind"]) == ("gap", "filled")
    noted = sum(stop - first for e in told if e["kind"] == "gap" for first, stop in e["ranges"])
    assert noted == cut.leader.backfill["missing"]
    assert cut.leader.recording["frames"] == len(expected)


async def test_after_a_stall_the_newest_frames_go_first_and_the_rest_is_filled_in(made, tmp_path):
    outcome = await run(made, tmp_path / "silent", "silence")
    backfill = outcome.leader.backfill
    assert outcome.follower.link["dropped"] == backfill["missing"] > 500
    assert backfill["filled"] == backfill["missing"]
    assert not any("follower lost" in said for said in outcome.said)
    np.testing.assert_array_equal(
        outcome.recording.frames["force_n"], read_session(made).frames["force_n"]
    )


@pytest.mark.parametrize("method", ["field", "published"])
async def test_live_replayed_and_offline_models_are_the_same_where_frames_are_lost_and_bridged(
    made, tmp_path, method
):
    """Some never came from the device, some the link has lost for good, others were sent again."""
    frames = read_session(made).frames
    missing = np.random.default_rng(1).random(len(frames)) < 0.01
    for first, count in ((1500, 3), (3100, 3), (4200, 30)):
        missing[first : first + count] = True
    missing[[0, -1]] = False
    file = tmp_path / "lossy.mcap"
    write_session(file, frames[~missing])
    lossy = {"delay_ms": 10.0, "loss": 0.02, "burst_messages": 2.0, "direction": "up"}
    live = await run(file, tmp_path / "live", None, lossy, method, keep_s=0.1)
    backfill, recording = live.leader.backfill, live.recording
    assert backfill["filled"] > 10
    assert backfill["lost"] > missing.sum() + 10
    assert backfill["waiting"] == live.leader.texture["late_frames"] == 0
    assert len(recording.frames) == len(frames) - backfill["lost"]
    places = recording.frames["sequence"].astype(np.int64)
    assert len(np.unique(places)) == len(places)
    np.testing.assert_array_equal(recording.frames["force_n"], frames["force_n"][places])

    history = offline(recording.frames, method)
    assert models_of(history, live) == live.models
    present = set(recording.frames["sequence"].tolist())
    bridged = [s for s in history.finished if not present.issuperset(range(s.start, s.stop))]
    assert len(bridged) > 2

    replayed = await asyncio.to_thread(replay_by_command, tmp_path, recording.path, method)
    np.testing.assert_array_equal(replayed.frames["sequence"], recording.frames["sequence"])
    assert replayed.models[-1] == live.models[-1]


def replay_by_command(directory, recorded, method):
    """What `mmt-leader --replay` and `mmt-follower --replay` record."""
    scene, again = directory / "scene.toml", directory / "again.mcap"
    texture = "\n".join(f"{key} = {json.dumps(value)}" for key, value in TEXTURES[method].items())
    scene.write_text(f"[link]\n[replay]\nspeed = {SPEED}\n[texture]\n{texture}\n")
    common = (scene, "--json-lines", "--replay", recorded)
    with Service("leader", *common, "--port", 0, "--record", again, cwd=directory) as leader:
        address = f"http://127.0.0.1:{leader.port()}"
        with Service("follower", *common, "--leader", address, cwd=directory) as follower:
            assert (leader.end(), follower.end()) == (0, 0), leader.stderr
    return read_session(again)


async def test_where_a_followers_numbers_wrap_the_model_and_the_recording_are_the_same(
    made, tmp_path, monkeypatch
):
    """A device that has counted for 49 days, and a gap in the midst of which 0 comes again.

    The network loses the last frames as well: they are delivered at the end.
    """
    frames = read_session(made).frames
    own = frames.copy()
    own["sequence"] = (frames["sequence"].astype(np.int64) - 3000) % SEQUENCES
    recording = tmp_path / "session.mcap"
    scene = replaying(made, link={"port": 0}, recording={"file": str(recording)})
    together = await Together.listening(scene)
    client = await together.client(keep_frames=5000, run_id="counting")
    for first in range(0, len(own), 20):
        with monkeypatch.context() as patched:
            if 2900 <= first < 3100 or first >= 7400:
                patched.setattr(client.endpoint.outbox, "put", lambda *_: None)
            client.send_frames(own[first : first + 20])
        await asyncio.sleep(0.02 / SPEED)
    await client.end("done")
    await client.disconnect()
    leader = await together.end()
    assert leader.backfill["filled"] == leader.backfill["missing"] == 200 + len(own) - 7400
    assert (leader.link["rejected"], leader.link["out_of_order"]) == ({}, 0)
    live = read_session(recording)
    np.testing.assert_array_equal(live.frames["sequence"], frames["sequence"])
    np.testing.assert_array_equal(live.frames["force_n"], frames["force_n"])
    time_s, model = live.models[-1]
    expected = offline(frames).model_at(time_s)
    assert model == expected.to_bytes()
