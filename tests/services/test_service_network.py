"""The services on an emulated network: what they say, count and record of it."""

import asyncio
from dataclasses import dataclass, field

import aiohttp
import numpy as np
from frame_samples import made_frames
from service_runs import MadeSource, Together, small_scene

from mmt.core.arrays import RecordArray
from mmt.core.frames import frame_dtype
from mmt.session.files import read_session


@dataclass
class SteadySource(MadeSource):
    """Streams frames with true times until it is told to end."""

    blocks: list[RecordArray] = field(default_factory=list)
    sequence: int = 0
    ended: bool = False

    def step(self, elapsed, now_ns, command_position_mm):
        if self.ended:
            self.finished = True
            return np.zeros(0, frame_dtype())
        frames = made_frames(self.sequence, elapsed)
        frames["time_ns"] = now_ns
        self.sequence += elapsed
        return frames


async def put(together, **table):
    url = f"http://127.0.0.1:{together.leader.port}/network"
    async with aiohttp.ClientSession() as http, http.put(url, json=table) as response:
        assert response.status == 200


async def test_a_network_that_changes_live_is_said_counted_and_recorded(tmp_path):
    together = Together.of(small_scene(tmp_path, network={"delay_ms": 15}))
    source = SteadySource()
    await together.listen()
    following = asyncio.create_task(together.follow(source))
    server = together.server
    await together.until(lambda: server.statistics.frames > 600)
    await put(together, loss=1.0)
    changed = "emulated network: 1 lost in bursts of 1"
    await together.until(lambda: f"follower: {changed}" in together.said)
    assert changed in together.said
    lost_from = source.sequence
    await together.until(lambda: source.sequence > lost_from + 50)
    await put(together)
    await together.until(lambda: "follower: emulated network: none" in together.said)
    frames = server.statistics.frames
    await together.until(lambda: server.statistics.frames > frames + 50)
    source.ended = True
    followed, leader = await following, await together.end()
    assert leader.outcome == "source ended"
    assert leader.link["lost"] >= 40
    assert followed.link["emulated"]["lost"] > 0
    assert leader.link["emulated"]["lost"] > 0
    assert leader.link["latency_p50_ms"] >= 15.0
    session = read_session(tmp_path / "session.mcap")
    assert changed in [event["event"] for event in session.events]
    assert leader.vibration["playout"]["age_ms"] > leader.vibration["playout"]["delay_ms"]


async def test_recording_and_metrics_have_the_clocks_and_the_emulation(tmp_path):
    network = {"duplicate": 0.5, "outage_s": 0.3, "outage_every_s": 0.6}
    together = Together.of(small_scene(tmp_path, network=network, metrics={}))
    source = SteadySource()
    await together.listen()
    following = asyncio.create_task(together.follow(source))
    server = together.server
    await together.until(lambda: server.clock.estimate and server.statistics.lost > 100)
    url = f"http://127.0.0.1:{together.leader.port}/metrics"
    async with aiohttp.ClientSession() as http, http.get(url) as response:
        lines = (await response.text()).splitlines()
    source.ended = True
    followed, leader = await following, await together.end()
    assert leader.outcome == "source ended"
    assert not any("lost (" in sentence for sentence in together.said), "an outage is silence"
    figures = {
        name: float(value)
        for name, value in (line.rsplit(" ", 1) for line in lines if line[0] != "#")
    }
    assert figures["mmt_clock_jumps_total"] == 0
    assert abs(figures["mmt_clock_offset_seconds"]) < 0.02
    assert figures["mmt_clock_uncertainty_seconds"] > 0
    emulated = leader.link["emulated"]
    assert 0 < figures['mmt_emulated_total{fate="repeated"}'] <= emulated["repeated"]
    assert figures['mmt_emulated_total{fate="lost"}'] <= emulated["lost"] > 0
    noted = [e for e in read_session(tmp_path / "session.mcap").events if "clock_time_ns" in e]
    assert {event["event"] for event in noted} == {"clocks compared"}
    assert all(event["same_clock"] and event["clock_offset_ns"] == 0 for event in noted)
    for summary in (followed, leader):
        assert summary.link["clock"]["exchanges"] >= 8
        assert abs(summary.link["clock"]["offset_ms"]) < 20.0  # the machine may be busy
        assert summary.link["clock"]["jumps"] == 0
