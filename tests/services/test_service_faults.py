"""What goes wrong in a session is counted, said, and never costs what was recorded."""

import asyncio

import numpy as np
import pytest
from frame_samples import made_frames
from modelling_beside import InThread
from service_runs import MadeSource, Together, run_session, small_scene

from mmt.core.errors import InputError, MmtError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL
from mmt.devices.protocols import InterfaceState
from mmt.leader.modelling import pipeline
from mmt.leader.motion.feedback import StreamedForce
from mmt.link.client import FollowerClient
from mmt.link.endpoint import FollowerEvents
from mmt.link.protocol import FollowerHello
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.online.modeller import OnlineModeller


def bad_blocks():
    """2000 frames, of which some are not finite, missing, repeated or late."""
    blocks = [made_frames(first, 10) for first in range(0, 2000, 10)]
    blocks[20]["acceleration_m_s2"][3, 2] = np.nan
    blocks[21]["force_n"][4, 0] = np.inf
    blocks[22]["position_mm"][5] = -np.inf
    late = blocks.pop(60)  # 10 frames that are missing at their turn
    blocks.insert(70, late)
    del blocks[90]
    blocks.insert(100, blocks[99].copy())
    return blocks


GOOD_SEQUENCES = sorted(
    set(range(2000)) - {203, 214, 225} - set(range(600, 610)) - set(range(900, 910))
)


async def test_the_numbers_of_commands_start_again_before_they_do_not_fit(tmp_path, monkeypatch):
    monkeypatch.setattr("mmt.leader.remote.SEQUENCES", 50, raising=False)
    together = await Together.listening(small_scene(tmp_path, session={"duration_s": 0.3}))
    numbers = []

    def note(command):
        numbers.append(int(command["sequence"][0]))

    monkeypatch.setattr(together.leader.remote.server, "send_commands", note)
    await together.follow()
    summary = await together.end()
    assert (summary.outcome, summary.problem) == ("completed", None)
    assert len(numbers) > 100
    assert numbers == [number % 50 for number in range(len(numbers))]


async def test_bad_frames_are_counted_and_the_model_never_sees_them(tmp_path, monkeypatch):
    seen = []
    segment = OnlineModeller.segment

    def watched(self, frames):
        seen.append(frames)
        return segment(self, frames)

    monkeypatch.setattr(OnlineModeller, "segment", watched)
    monkeypatch.setattr(pipeline, "ModellingProcess", InThread)
    scene = small_scene(tmp_path, texture={"update_period_s": 0.1}, rendering={})
    leader, follower = await run_session(scene, MadeSource(bad_blocks()))
    assert (leader.outcome, leader.problem) == ("source ended", None)
    assert (follower.outcome, follower.problem) == ("source ended", None)
    assert leader.link["frames"] == len(GOOD_SEQUENCES)
    assert leader.link["rejected"]["not finite"] == 3
    filled = leader.backfill["filled"]
    assert filled in {0, 10}  # the late ones, unless they are asked for before the source has them
    assert leader.backfill["missing"] == leader.backfill["lost"] + filled == 23
    assert (leader.link["lost"], leader.link["out_of_order"], leader.link["repeated"]) == (
        20,
        10,
        10,
    )
    modelled = np.concatenate(seen)
    assert len(modelled) > 1500
    assert all(np.isfinite(modelled[FIELD_OF_CHANNEL[channel]]).all() for channel in CHANNELS)
    assert (np.diff(modelled["sequence"].astype(np.int64)) > 0).all()
    recording = read_session(tmp_path / "session.mcap")
    late = list(range(600, 600 + filled))
    assert recording.frames["sequence"].tolist() == sorted([*GOOD_SEQUENCES, *late])
    assert recording.annotations == b"as made"


async def test_a_follower_that_fails_says_why_on_both_sides(tmp_path):
    together = Together.of(small_scene(tmp_path))
    source = MadeSource(
        [made_frames(k, 1) for k in range(200)],
        error=MmtError("the probe is unplugged"),
        close_error=MmtError("the probe does not close"),
    )
    await together.listen()
    follower, leader = await together.follow(source), await together.end()
    assert follower.problem == "failed: the probe is unplugged"
    assert leader.problem == "follower failed: the probe is unplugged"
    assert source.closed
    assert "follower: the probe does not close" in together.said
    recording = read_session(tmp_path / "session.mcap")
    assert len(recording.frames) == 200
    said = [event["event"] for event in recording.events]
    assert "follower ended: failed: the probe is unplugged" in said


async def test_a_mistake_in_a_source_comes_out_but_the_leader_is_told(tmp_path):
    together = await Together.listening(small_scene(tmp_path))
    with pytest.raises(ZeroDivisionError):
        await together.follow(MadeSource([made_frames(0, 50)], error=ZeroDivisionError("oops")))
    assert (await together.end()).problem == "follower failed: oops"
    assert len(read_session(tmp_path / "session.mcap").frames) == 50


class BrokenHand:
    """An operator's handle that fails at its hundredth reading."""

    def __init__(self, error):
        self.error = error
        self.readings = 0

    def connect(self): ...

    def calibrate(self): ...

    def close(self):
        raise self.error

    def read(self, elapsed_ticks):
        self.readings += 1
        if self.readings > 100:
            raise self.error
        return InterfaceState((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0, contact=False)

    def write(self, force_n): ...


async def test_a_device_of_the_leader_that_fails_ends_both(tmp_path):
    together = Together.of(small_scene(tmp_path))
    together.leader.parts.hand.device = BrokenHand(MmtError("the handle does not answer"))
    await together.listen()
    source = MadeSource([made_frames(k, 1) for k in range(3000)])
    follower, leader = await together.follow(source), await together.end()
    assert leader.problem == "failed: the handle does not answer"
    assert follower.problem == "leader failed: the handle does not answer"
    assert "closing BrokenHand: the handle does not answer" in together.said
    recording = read_session(tmp_path / "session.mcap")
    assert 50 < len(recording.frames) == leader.link["frames"] < 3000


async def test_a_part_that_does_not_stop_leaves_the_recording_whole(tmp_path):
    async def stop():
        raise OSError("the network is down")

    together = Together.of(small_scene(tmp_path))
    hand = together.leader.parts.hand
    hand.stop = stop
    await together.listen()
    source = MadeSource([made_frames(k, 1) for k in range(200)])
    _, leader = await together.follow(source), await together.end()
    assert f"stopping {hand.name}: the network is down" in together.said
    recording = read_session(tmp_path / "session.mcap")
    assert recording.complete
    assert len(recording.frames) == leader.link["frames"] > 0


async def test_a_mistake_in_the_leader_comes_out_with_the_recording_whole(tmp_path):
    together = Together.of(small_scene(tmp_path))
    together.leader.parts.hand.device = BrokenHand(ZeroDivisionError("oops"))
    await together.listen()
    source = MadeSource([made_frames(k, 1) for k in range(3000)])
    assert (await together.follow(source)).problem == "leader failed: oops"
    with pytest.raises(ZeroDivisionError):
        await together.end()
    assert read_session(tmp_path / "session.mcap").complete


async def test_a_mistake_on_a_frame_ends_the_session_and_comes_out(tmp_path, monkeypatch):
    together = Together.of(small_scene(tmp_path))

    def broken(*_):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(together.leader.parts.playout, "on_frames", broken)
    await together.listen()
    follower = await together.follow(MadeSource([made_frames(k, 1) for k in range(3000)]))
    assert follower.problem == "leader failed: oops"
    with pytest.raises(ZeroDivisionError):
        await together.end()


async def test_a_recording_that_cannot_be_made_is_explained_at_the_start(tmp_path):
    (tmp_path / "file").write_text("no folder")
    file = tmp_path / "file" / "session.mcap"
    together = await Together.listening(small_scene(tmp_path, recording={"file": str(file)}))
    with pytest.raises(InputError, match=r"session\.mcap: (Not a directory|File exists)"):
        await together.end()


async def test_a_port_that_is_taken_leaves_an_older_recording_alone(tmp_path):
    first = await Together.listening(small_scene(tmp_path))
    recording = tmp_path / "older.mcap"
    recording.write_bytes(b"precious")
    second = await Together.listening(
        small_scene(tmp_path, link={"port": first.leader.port}, recording={"file": str(recording)})
    )
    with pytest.raises(MmtError, match="cannot listen on"):
        await second.end()
    assert recording.read_bytes() == b"precious"
    first.leader.stop()
    assert (await first.end()).outcome == "stopped"


class FeelingHand(BrokenHand):
    """Notes the forces that it displays."""

    def __init__(self):
        super().__init__(MmtError(""))
        self.forces = []

    def write(self, force_n):
        self.forces.append(force_n)


async def test_force_and_vibration_fade_when_the_follower_is_lost(tmp_path):
    together = Together.of(small_scene(tmp_path, force_feedback={}))
    hand = FeelingHand()
    together.leader.parts.force_feedback.feedback = StreamedForce(hand, limit_n=3.0)
    await together.listen()
    follower = FollowerClient(
        f"http://127.0.0.1:{together.leader.port}",
        FollowerHello(channels=CHANNELS, source="test"),
        FollowerEvents(on_commands=lambda *_: None),
    )
    sent = 0

    def full_force_is_felt():
        nonlocal sent
        frames = made_frames(sent, 30)
        frames["force_n"] = (0.0, 0.0, 2.0)
        follower.send_frames(frames)
        sent += len(frames)
        return (0.0, 0.0, 2.0) in hand.forces

    await follower.connect(5.0)
    await together.until(full_force_is_felt)
    await follower.disconnect()
    leader = await together.end()
    assert leader.problem == "follower lost"
    assert hand.forces[-1] == (0.0, 0.0, 0.0)
    normal = [force[2] for force in hand.forces]
    fading = normal[len(normal) - normal[::-1].index(2.0) :]
    assert (np.diff(fading) <= 0.0).all()
    assert len(fading) > 100
    outputs = read_session(tmp_path / "session.mcap").outputs
    assert any(np.abs(output.vibration_m_s2).max() > 0.1 for output in outputs)
    assert (outputs[-1].vibration_m_s2 == 0.0).all()


async def test_resetting_the_model_fades_back_to_the_stream_and_begins_anew(tmp_path):
    frames, annotations = simulate_session(Scene(), "plastic", 6.0, 1)
    write_session(tmp_path / "made.mcap", frames, annotations=annotations)
    scene = scene_from_tables(
        {
            "session": {"duration_s": 600.0},
            "link": {"port": 0},
            "replay": {"file": str(tmp_path / "made.mcap"), "speed": 4.0, "loop": True},
            "texture": {"order": 4},
            "rendering": {"crossfade_ms": 100.0},
            "playout": {},
            "actuator": {},
            "recording": {"file": str(tmp_path / "session.mcap")},
        }
    )
    together = Together.of(scene)
    leader = together.leader
    await together.listen()
    follower = together.follower()
    following = asyncio.create_task(follower.run())

    def modes():
        return [switch["mode"] for switch in leader.log.switches]

    await together.until(lambda: modes()[-1:] == ["synthesized"])
    first_start_s, reset_s = leader.log.start_s, leader.time_s
    leader.reset_model()
    assert leader.status().samples == 0
    assert leader.log.start_s is None
    await together.until(lambda: modes()[-1:] == ["synthesized"] and len(modes()) > 2)
    leader.stop()
    summary = await together.end()
    assert (await following).outcome == "leader stopped (stopped)"
    settled = [mode for mode in modes() if mode != "fading"]
    assert settled == ["synthesized", "streamed", "synthesized"]
    assert 0 < first_start_s <= reset_s < summary.texture["start_s"] <= leader.time_s
    recording = read_session(tmp_path / "session.mcap")
    most_at_once = max(len(output.vibration_m_s2) for output in recording.outputs)
    assert modes().count("fading") == 3 or most_at_once >= 100  # a tick that made up a whole fade
    times_s = [time_s for time_s, _ in recording.models]
    assert times_s == sorted(times_s)
    assert len(times_s) >= 4
    assert "model reset" in [event["event"] for event in recording.events]


async def test_a_number_far_ahead_neither_ends_the_session_nor_counts_as_lost(tmp_path):
    blocks = [made_frames(k, 1) for k in range(100)]
    for huge in (2**31, 2**30, 10**6):
        block = made_frames(0, 1)
        block["sequence"] = huge
        blocks[50:50] = [block]
    last = made_frames(0, 1)
    last["sequence"] = 2**31
    leader, _ = await run_session(small_scene(tmp_path), MadeSource([*blocks, last]))
    assert leader.outcome == "source ended"
    assert leader.session["duration_s"] == 0.1
    assert leader.link["frames"] == 100
    assert leader.link["lost"] == 0
    assert leader.link["rejected"] == {"implausible jump": 4, "implausible count": 1}
    recorded = read_session(tmp_path / "session.mcap").frames["sequence"]
    assert recorded.tolist() == list(range(100))
