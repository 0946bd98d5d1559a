"""What an outage kept back is filled in: the model and the recording are those without it."""

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_samples import made_frames
from service_runs import Together, small_scene
from wire_relay import relay

from mmt.core.frames import CHANNELS
from mmt.follower.service import Follower, FollowerSummary
from mmt.leader.summary import LeaderSummary
from mmt.link.client import FollowerClient, FollowerEvents
from mmt.link.protocol import FollowerHello
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session import RecordedSession, read_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.model.texture_model import TextureModel

SPEED = 2.0
"""Session time runs so many times faster, to save time."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
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
    def model(self) -> TextureModel:
        return TextureModel.from_bytes(self.recording.models[-1][1])


async def run(
    made: Path,
    directory: Path,
    outage: str | None,
    network: dict[str, Any] | None = None,
    **link: Any,
) -> Outcome:
    """Run the session over the real link, with an outage of 1.5 s of session time or none."""
    directory.mkdir()
    scene = scene_from_tables(
        {
            "session": {"duration_s": 60.0},
            "link": {"port": 0, "patience_s": 10.0, **link},
            "replay": {"file": str(made), "speed": SPEED},
            "texture": {"start_share": 0.1, "stop_share": 0.9999},
            "rendering": {},
            "playout": {},
            "actuator": {},
            "recording": {"file": str(directory / "session.mcap")},
            **({"network": network} if network is not None else {}),
        }
    )
    together = Together.of(scene)
    await together.listen()
    async with relay(together.leader.port or 0) as wire:
        follower = Follower(scene, f"http://127.0.0.1:{wire.port}")
        following = asyncio.create_task(follower.run())
        if outage is not None:
            await together.until(lambda: together.leader.time_s > 2.2)
            wire.cut() if outage == "cut" else wire.fall_silent()
            await asyncio.sleep(1.5 / SPEED)
            wire.mend()
        followed = await following
        led = await together.end()
    return Outcome(led, followed, read_session(directory / "session.mcap"), together.said)


async def test_the_model_after_an_outage_equals_the_one_without_it(
    made: Path, tmp_path: Path
) -> None:
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
    for field in ("speed_mm_s", "force_n", "lsf", "variance", "power"):
        np.testing.assert_allclose(
            getattr(cut.model.samples, field), getattr(whole.model.samples, field), rtol=1e-12
        )
    assert len(cut.model.samples.power) > 3

    expected = read_session(made).frames
    for recording in (whole.recording, cut.recording):
        for name in ("sequence", "position_mm", "force_n", "acceleration_m_s2"):
            np.testing.assert_array_equal(recording.frames[name], expected[name])
        assert (np.diff(recording.frames["time_ns"]) == 1_000_000).all()
    kinds = [event["kind"] for event in cut.recording.events if "kind" in event]
    assert kinds[0] == "gap"
    assert kinds[-1] == "filled"
    assert cut.leader.recording["frames"] == len(expected)


async def test_after_a_stall_the_newest_frames_go_first_and_the_rest_is_filled_in(
    made: Path, tmp_path: Path
) -> None:
    outcome = await run(made, tmp_path / "silent", "silence")
    backfill = outcome.leader.backfill
    assert outcome.follower.link["dropped"] == backfill["missing"] > 500
    assert backfill["filled"] == backfill["missing"]
    assert not any("follower lost" in said for said in outcome.said)
    np.testing.assert_array_equal(
        outcome.recording.frames["force_n"], read_session(made).frames["force_n"]
    )


async def test_what_an_emulated_network_loses_is_filled_in(made: Path, tmp_path: Path) -> None:
    lossy = {"delay_ms": 20.0, "loss": 0.05, "burst_messages": 4.0}
    outcome = await run(made, tmp_path / "lossy", None, network=lossy)
    backfill = outcome.leader.backfill
    assert backfill["missing"] > 100
    assert backfill["filled"] > 0.95 * backfill["missing"]
    expected = read_session(made).frames
    recorded = outcome.recording.frames
    assert len(np.unique(recorded["sequence"])) == len(recorded)
    assert len(recorded) == len(expected) - backfill["lost"]
    places = recorded["sequence"].astype(np.int64)
    np.testing.assert_array_equal(recorded["force_n"], expected["force_n"][places])


async def test_where_nothing_is_kept_a_gap_stays_a_gap_and_is_marked(
    made: Path, tmp_path: Path
) -> None:
    outcome = await run(made, tmp_path / "off", "cut", keep_s=0.0)
    assert outcome.follower.backfill == {}
    missing = outcome.leader.backfill["missing"]
    assert outcome.leader.backfill["lost"] == missing > 700
    steps = np.diff(outcome.recording.frames["sequence"].astype(np.int64))
    assert steps[steps > 1].tolist() == [missing + 1]
    (gap,) = (event for event in outcome.recording.events if event.get("kind") == "gap")
    start = int(np.flatnonzero(steps > 1)[0])
    assert gap["ranges"] == [[start + 1, start + 1 + missing]]


async def test_a_follower_that_is_started_anew_is_not_asked_for_what_the_old_one_had(
    tmp_path: Path,
) -> None:
    together = Together.of(
        small_scene(tmp_path, link={"port": 0, "patience_s": 5.0}, playout=None, actuator=None)
    )
    await together.listen()

    def client(run_id: str) -> FollowerClient:
        return FollowerClient(
            f"http://127.0.0.1:{together.leader.port}",
            FollowerHello(channels=CHANNELS, source="test", keep_frames=5000, run_id=run_id),
            FollowerEvents(on_commands=lambda *_: None),
        )

    first, second = client("first"), client("second")
    await first.connect(5.0)
    first.send_frames(made_frames(0, 100))
    first.send_frames(made_frames(150, 50))
    await together.until(lambda: together.leader.time_s == 0.2)
    await first.disconnect()
    await together.until(lambda: any("follower lost" in said for said in together.said))
    await second.connect(5.0)
    second.send_frames(made_frames(300, 50))  # as if it had gone on counting
    await together.until(lambda: together.leader.time_s > 0.25)
    await second.end("done")
    await second.disconnect()
    leader = await together.end()
    assert any("started anew" in said for said in together.said)
    assert leader.backfill["missing"] == leader.backfill["lost"] > 50  # and the time between
    assert second.backfill["asked"] == second.backfill["gone"] == 0
    frames = read_session(tmp_path / "session.mcap").frames
    assert len(frames) == 200
    assert (np.diff(frames["sequence"].astype(np.int64)) > 0).all()


async def test_a_follower_that_is_stopped_in_an_outage_of_the_network_delivers_the_rest(
    tmp_path: Path,
) -> None:
    together = Together.of(small_scene(tmp_path, playout=None, actuator=None))
    await together.listen()
    client = FollowerClient(
        f"http://127.0.0.1:{together.leader.port}",
        FollowerHello(channels=CHANNELS, source="test", keep_frames=5000),
        FollowerEvents(on_commands=lambda *_: None),
    )
    await client.connect(5.0)
    client.send_frames(made_frames(0, 100))
    await together.until(lambda: together.leader.time_s == 0.1)
    put, client._endpoint.outbox.put = client._endpoint.outbox.put, lambda *_: None  # type: ignore[method-assign]
    for first in range(100, 1000, 10):
        client.send_frames(made_frames(first, 10))
    client._endpoint.outbox.put = put  # type: ignore[method-assign]
    await client.end("done")
    await client.disconnect()
    leader = await together.end()
    assert leader.backfill["filled"] == 900
    assert leader.session["duration_s"] == 1.0
    frames = read_session(tmp_path / "session.mcap").frames
    np.testing.assert_array_equal(frames["sequence"], np.arange(1000))
