"""What goes wrong in a session is counted, said, and never costs what was recorded."""

import asyncio

import numpy as np
import pytest
from frame_samples import made_frames
from modelling_beside import InThread
from service_runs import MadeSource, Together, run_session, small_scene

from mmt.core.errors import MmtError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL
from mmt.devices.protocols import InterfaceState
from mmt.leader.modelling import process
from mmt.leader.motion.feedback import StreamedForce
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
    assert len(numbers) > 60  # of 300, on a machine that is busy
    assert numbers == [number % 50 for number in range(len(numbers))]


async def test_bad_frames_are_counted_and_the_model_never_sees_them(tmp_path, monkeypatch):
    seen = []
    segment = OnlineModeller.segment

    def watched(self, frames):
        seen.append(frames)
        return segment(self, frames)

    monkeypatch.setattr(OnlineModeller, "segment", watched)
    monkeypatch.setattr(process, "ModellingProcess", InThread)
    scene = small_scene(tmp_path, texture={"update_period_s": 0.1}, rendering={})
    leader, follower = await run_session(scene, MadeSource(bad_blocks()))
    assert (leader.outcome, leader.problem) == ("source ended", None)
    assert (follower.outcome, follower.problem) == ("source ended", None)
    assert leader.link["frames"] == len(GOOD_SEQUENCES)
    assert leader.link["rejected"]["not finite"] == 3
    filled = leader.backfill["filled"]
    assert filled in {0, 10}  # the late ones, unless they are asked for before the source has them
    assert leader.backfill["missing"] == leader.backfill["lost"] + filled == 23
    counts = leader.link["lost"], leader.link["out_of_order"], leader.link["repeated"]
    assert counts == (20, 10, 10)
    modelled = np.concatenate(seen)
    assert len(modelled) > 1500
    assert all(np.isfinite(modelled[FIELD_OF_CHANNEL[channel]]).all() for channel in CHANNELS)
    assert (np.diff(modelled["sequence"].astype(np.int64)) > 0).all()
    recording = read_session(tmp_path / "session.mcap")
    late = list(range(600, 600 + filled))
    assert recording.frames["sequence"].tolist() == sorted([*GOOD_SEQUENCES, *late])
    assert recording.annotations == b"as made"


@pytest.mark.parametrize(("kind", "count"), [(MmtError, 200), (ZeroDivisionError, 50)])
async def test_a_follower_that_fails_says_why_on_both_sides_and_a_mistake_comes_out(
    tmp_path, kind, count
):
    together = await Together.listening(small_scene(tmp_path))
    source = MadeSource(
        [made_frames(k, 1) for k in range(count)],
        error=kind("the probe is unplugged"),
        close_error=MmtError("the probe does not close"),
    )
    if kind is MmtError:
        follower = await together.follow(source)
        assert follower.problem == "failed: the probe is unplugged"
        assert "follower: the probe does not close" in together.said
    else:
        with pytest.raises(ZeroDivisionError):
            await together.follow(source)
    leader = await together.end()
    assert leader.problem == "follower failed: the probe is unplugged"
    assert source.closed
    recording = read_session(tmp_path / "session.mcap")
    assert len(recording.frames) == count
    said = [event["event"] for event in recording.events]
    assert "follower ended: failed: the probe is unplugged" in said


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


@pytest.mark.parametrize(
    ("error", "where", "least"),
    [
        (MmtError("the handle does not answer"), "hand", 51),
        (ZeroDivisionError("oops"), "hand", 51),
        (ZeroDivisionError("oops"), "frames", 0),
    ],
    ids=str,
)
async def test_what_fails_in_the_leader_ends_both_with_the_recording_whole(
    tmp_path, monkeypatch, error, where, least
):
    """A device, a mistake in the tick, and a mistake on a frame; mistakes come out."""

    def broken(*_):
        raise error

    together = Together.of(small_scene(tmp_path))
    if where == "hand":
        together.leader.parts.hand.device = BrokenHand(error)
    else:
        monkeypatch.setattr(together.leader.parts.playout, "on_frames", broken)
    await together.listen()
    follower = await together.follow(MadeSource([made_frames(k, 1) for k in range(3000)]))
    assert follower.problem == f"leader failed: {error}"
    if isinstance(error, MmtError):
        leader = await together.end()
        assert leader.problem == f"failed: {error}"
        assert f"closing BrokenHand: {error}" in together.said
        assert len(read_session(tmp_path / "session.mcap").frames) == leader.link["frames"]
    else:
        with pytest.raises(ZeroDivisionError):
            await together.end()
    recording = read_session(tmp_path / "session.mcap")
    assert recording.complete
    assert least <= len(recording.frames) < 3000


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
    sent = 0

    def full_force_is_felt():
        nonlocal sent
        frames = made_frames(sent, 30)
        frames["force_n"] = (0.0, 0.0, 2.0)
        follower.send_frames(frames)
        sent += len(frames)
        return (0.0, 0.0, 2.0) in hand.forces

    follower = await together.client()
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
