"""The documented layout, against python-socketio itself and against the program in the page."""

import asyncio
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import socketio
from aiohttp import web
from link_samples import (
    CHANNELS,
    FollowerNotes,
    LeaderNotes,
    commands,
    follower,
    frames,
    leader,
    until,
)
from python_programs import printed_by

from mmt.core.frames import CHANNELS as ALL_CHANNELS
from mmt.core.frames import COMMAND_DTYPE, frame_dtype

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "wire.md"

AUTH = {
    "protocol": 1,
    "rate_hz": 1000,
    "channels": ["force", "position"],
    "frames_per_message": 1,
    "source": "stock client",
    "clock_id": "",
    "annotations": b"",
}


def test_the_layouts_are_those_of_the_page():
    text = PAGE.read_text(encoding="utf-8")
    rows = dict.fromkeys(re.findall(r"^\| (\d+) \| [^|]+ \| `(\w+)`", text, re.MULTILINE))
    fields = {}
    for offset, name in rows:
        fields.setdefault(name, set()).add(int(offset))
    for dtype in (frame_dtype(ALL_CHANNELS), COMMAND_DTYPE):
        for name, (_, offset, *_) in dtype.fields.items():
            assert offset in fields[name], name
    assert struct.calcsize("<Iq9f") == frame_dtype(ALL_CHANNELS).itemsize == 48
    assert struct.calcsize("<Iqqq3f") == COMMAND_DTYPE.itemsize == 40


async def test_a_stock_client_can_take_the_followers_place():
    up = LeaderNotes()
    heard = []
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False)
    client.on("*", lambda event, data: heard.append((event, data)))
    async with leader(up) as server:
        url = f"http://127.0.0.1:{server.port}"
        with pytest.raises(socketio.exceptions.ConnectionError):
            await client.connect(url, auth=AUTH, transports=["polling"])
        await client.connect(url, auth=AUTH, transports=["websocket"])
        await client.emit("frames", struct.pack("<Iq6f", 0, 77, 1, 2, 3, 4, 5, 6))
        await until(lambda: up.blocks)
        server.send_commands(commands(9))
        stopping = asyncio.create_task(server.request_stop("enough"))
        await until(lambda: len(heard) == 3)
        answer = await client.call("end", {"reason": "bye", "frames": 1}, timeout=5)
        await client.disconnect()
        await stopping
    assert answer is None
    frame = up.blocks[0][0]
    assert (frame["sequence"], frame["time_ns"]) == (0, 77)
    assert frame["position_mm"].tolist() == [1, 2, 3]
    assert frame["force_n"].tolist() == [4, 5, 6]
    assert up.ends == ["bye"]
    kinds = dict(heard)
    assert kinds["welcome"]["protocol"] == 1
    assert kinds["stop"] == {"reason": "enough"}
    command = struct.unpack("<Iqqq3f", kinds["commands"])
    assert command == (9, 1, 0, 0, 2.5, 2.5, 2.5)


async def test_the_program_in_the_page_runs(tmp_path):
    match = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    program = tmp_path / "follower.py"
    program.write_text(match.group(1), encoding="utf-8")
    notes = LeaderNotes()
    async with leader(notes, channels=ALL_CHANNELS) as server:
        url = f"http://127.0.0.1:{server.port}"
        running = asyncio.create_task(asyncio.to_thread(printed_by, program, url, 500))
        await until(lambda: notes.blocks)
        server.send_commands(commands(0))
        output = await running
    assert "command 0: go to 2.50 2.50 2.50 mm" in output
    assert notes.sequences == list(range(500))
    times_ns = np.concatenate(notes.blocks)["time_ns"]
    assert (times_ns[-1] - times_ns[0]) / 499 == pytest.approx(1e6, rel=0.2)  # not 660 Hz
    assert notes.ends == ["example over"]
    assert notes.losses == []


async def test_our_follower_can_talk_to_a_stock_server():
    heard = []
    server = socketio.AsyncServer(async_mode="aiohttp", serializer="msgpack")

    @server.on("connect")
    def connect(sid, environ, auth):
        heard.append(("connect", auth))

    @server.on("*")
    def note(event, sid, data):
        heard.append((event, data))

    application = web.Application()
    server.attach(application)
    runner = web.AppRunner(application, shutdown_timeout=1.0)
    await runner.setup()
    await web.TCPSite(runner, "127.0.0.1", 0).start()
    notes = FollowerNotes()
    async with follower(runner.addresses[0][1], notes, source="x") as client:
        client.send_frames(frames(3))
        await until(lambda: len(heard) == 2)
        await server.emit("commands", struct.pack("<Iqqq3f", 5, 1, 0, 0, 1, 2, 3))
        await until(lambda: notes.blocks)
        await client.end("done")
    await server.shutdown()
    await runner.cleanup()
    assert heard[0][1]["channels"] == list(CHANNELS)
    assert heard[1] == ("frames", frames(3).tobytes())
    assert heard[2] == ("end", {"reason": "done", "frames": 4})
    assert notes.blocks[0]["position_mm"].tolist() == [[1, 2, 3]]
