"""A follower in another language: npm's stock socket.io-client under Node."""

import asyncio
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import socketio
from link_samples import CHANNELS, LeaderNotes, commands, leader, until
from node_programs import NEEDS_NODE, another_site, run_node, under_node
from socketio.msgpack_packet import MsgPackPacket

from mmt.link.protocol import PROTOCOL_VERSION

DOCUMENTED = ("position", "force", "acceleration")
PROGRAM = Path(__file__).with_name("stock_follower.cjs")

pytestmark = NEEDS_NODE


async def follow(port, count, protocol=PROTOCOL_VERSION, sending="plain"):
    return await run_node(PROGRAM, f"http://127.0.0.1:{port}", count, protocol, sending)


@pytest.mark.parametrize("sending", ["plain", "compressed"])
async def test_a_stock_client_under_node_streams_frames_and_decodes_commands(monkeypatch, sending):
    count, by_the_library = 200, []
    notes = LeaderNotes()
    servers = []
    usual = MsgPackPacket.decode

    def decode(self, encoded):
        usual(self, encoded)
        if self.packet_type == socketio.packet.EVENT:
            by_the_library.append(self.data[0])

    def answer(block, arrival_ns):
        notes.blocks.append(block)
        for frame in block:
            answered = commands(int(frame["sequence"]), time_ns=2**62 + 1)
            answered["echo_time_ns"] = frame["time_ns"]
            answered["echo_age_ns"] = 123
            answered["position_mm"] = frame["position_mm"]
            servers[0].send_commands(answered)

    monkeypatch.setattr(MsgPackPacket, "decode", decode)
    async with leader(events=replace(notes.events(), on_frames=answer)) as server:
        servers.append(server)
        code, printed, complaints = await follow(server.port, count, sending=sending)
        counted = server.statistics
    assert (code, complaints) == (0, "")
    heard = json.loads(printed)
    assert heard["welcome"]["protocol"] == PROTOCOL_VERSION
    assert heard["sizes"] == [40] * count

    frames = np.concatenate(notes.blocks)
    assert frames["sequence"].tolist() == list(range(count))
    assert frames["position_mm"][7].tolist() == [7.25, 0.5, 0.75]
    assert frames["force_n"][7].tolist() == [0, 0, -1.5]
    for number, command in enumerate(heard["commands"]):
        assert command == {
            "sequence": number,
            "time_ns": str(2**62 + 1),
            "echo_time_ns": str(frames["time_ns"][number]),
            "echo_age_ns": "123",
            "position_mm": [number + 0.25, 0.5, 0.75],
        }
    assert by_the_library == []  # each message is decoded once, by `mmt.link.websocket`
    assert (counted.lost, counted.out_of_order, counted.repeated, counted.rejected) == (0, 0, 0, {})
    assert notes.hellos[0].annotations == b"any bytes"
    assert notes.hellos[0].channels == CHANNELS
    assert notes.ends == ["node is done"]
    assert notes.losses == notes.errors == []


async def test_a_stock_client_reads_why_it_is_refused():
    async with leader() as server:
        code, printed, complaints = await follow(server.port, 1, protocol=99)
    assert code == 1
    assert printed == ""
    assert "protocol 99" in complaints


async def streamed(notes, server):
    """Take a second of the documented follower's frames, command it, and let it end."""
    await until(lambda: len(notes.sequences) > 1000)
    await until(lambda: server.clock.offset_ns is not None)
    server.send_commands(commands(0, 3))
    await server.request_stop("done")
    await until(lambda: notes.ends)
    frames = np.concatenate(notes.blocks)
    assert frames["sequence"].tolist() == list(range(len(frames)))
    assert set(np.rint(np.diff(frames["time_ns"]) / 1e5)) == {10}
    assert (server.statistics.lost, server.statistics.rejected) == (0, {})
    assert notes.ends == ["stopped"]


async def test_the_documented_follower_streams_from_node(tmp_path):
    notes = LeaderNotes()
    async with leader(notes, channels=DOCUMENTED) as server:
        last = 'leader.on("disconnect", () => console.log(JSON.stringify(target_mm)));'
        program = under_node(tmp_path, "A follower", f"http://127.0.0.1:{server.port}", last)
        running = asyncio.create_task(run_node(program))
        await streamed(notes, server)
        assert await running == (0, "[2.5,2.5,2.5]\n", "")


async def test_the_documented_follower_streams_from_a_page_of_another_site(tmp_path):
    notes = LeaderNotes()
    async with (
        another_site(tmp_path) as (link, show),
        leader(notes, channels=DOCUMENTED, **link) as server,
    ):
        page, _ = await show(f"http://127.0.0.1:{server.port}", "A follower")
        await streamed(notes, server)
        assert await page.evaluate("target_mm") == [2.5, 2.5, 2.5]
