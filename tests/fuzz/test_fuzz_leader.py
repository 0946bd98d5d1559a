"""A hostile follower, or anybody who finds the port: the leader lives, within its limits."""

import asyncio
import contextlib
import math

import aiohttp
import fuzzing
import numpy as np
import psutil
import pytest
from hypothesis import strategies as st

from mmt.core.errors import FAILED
from mmt.core.frames import CONTACT, ENERGY, frame_dtype
from mmt.leader.service import Leader
from mmt.link.client import FollowerClient
from mmt.link.endpoint import FollowerEvents
from mmt.link.incoming import BlockReader
from mmt.link.protocol import FollowerHello
from mmt.link.websocket import binary_event, decode_packet
from mmt.scene.files import scene_from_tables

LIMIT_M_S2 = 20.0
LIMIT_N = 2.0
MOST_GROWTH_MB = 300.0

CHANNELS = frame_dtype()
NAMES = ("position", "force", "acceleration")
HELLO = FollowerHello(channels=NAMES, source="fuzz").to_auth()

MOVES = (
    st.tuples(st.just("binary"), fuzzing.BINARY)
    | st.tuples(st.just("binary"), fuzzing.EVENT_PACKETS)
    | st.tuples(st.just("binary"), fuzzing.FRAMES.map(lambda f: fuzzing.packet(2, ["frames", f])))
    | st.tuples(
        st.just("binary"), fuzzing.ENERGIES.map(lambda data: fuzzing.packet(2, [ENERGY, data]))
    )
    | st.tuples(
        st.just("binary"), fuzzing.CONTACTS.map(lambda data: fuzzing.packet(2, [CONTACT, data]))
    )
    | st.tuples(st.just("text"), fuzzing.TEXT)
    | st.tuples(st.just("hello"), st.just(HELLO) | fuzzing.ANYTHING)
    | st.tuples(
        st.just("hello"),
        st.tuples(st.sampled_from(sorted(HELLO)), fuzzing.ANYTHING).map(
            lambda change: {**HELLO, change[0]: change[1]}
        ),
    )
    | st.tuples(st.just("http"), fuzzing.HTTP)
    | st.tuples(st.just("reconnect"), st.none())
)


EXTRA = {"streamed": "", "passive": ENERGY, "model": CONTACT}
"""The further event of a method of force feedback."""


class Attacked:
    """A leader that is started anew when a session has ended, and what came out of it."""

    def __init__(self, directory, method):
        self.extra = EXTRA[method]
        self._scene = scene_from_tables(
            {
                "link": {"port": 0, "patience_s": 0.5},  # a place is soon free again
                "simulated": {},
                "hand": {},
                "playout": {},
                "texture": {"update_period_s": 0.1},
                "rendering": {},
                "network": {},
                "actuator": {"limit_m_s2": LIMIT_M_S2},
                "force_feedback": {"limit_n": LIMIT_N, "method": method},
                "recording": {"file": str(directory / "session.mcap")},
                "session": {"duration_s": 3600},
            }
        )
        self.http = None
        self.leader = None
        self._running = None

    async def ready(self):
        """Return a leader that listens: the one that there is, or a new one."""
        self.http = self.http or aiohttp.ClientSession()
        if self.leader is not None and self._running is not None:
            if not self.leader.ending.reached:
                return self.leader
            check_end(await asyncio.wait_for(self._running, 30))
        self.leader = leader = Leader(self._scene)
        watch(leader)
        listening = asyncio.Event()
        self._running = asyncio.create_task(leader.run(listening.set))
        waiting = asyncio.create_task(listening.wait())
        await asyncio.wait([self._running, waiting], return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        return leader

    async def close(self):
        if self.leader is not None and self._running is not None:
            self.leader.stop()
            check_end(await asyncio.wait_for(self._running, 30))
        if self.http is not None:
            await self.http.close()


def check_end(summary):
    assert not summary.outcome.startswith(FAILED), summary.outcome


def watch(leader):
    """Let whatever leaves the limits raise in the tick, which ends the session as failed."""
    actuator = leader.parts.vibration.actuator
    hand = leader.parts.hand.device
    play, show = actuator.write, hand.write

    def write(samples_m_s2):
        values = np.asarray(samples_m_s2)
        assert np.isfinite(values).all()
        assert (np.abs(values) <= LIMIT_M_S2).all()
        play(samples_m_s2)

    def display(force_n):
        assert math.hypot(*force_n) <= LIMIT_N * (1 + 1e-9)
        show(force_n)

    actuator.write = write
    hand.write = display


async def attack(attacked, moves):
    leader = await attacked.ready()
    assert attacked.http is not None
    url = f"http://127.0.0.1:{leader.port}/socket.io/?EIO=4&transport=websocket"
    async with contextlib.AsyncExitStack() as stack:
        try:
            websocket = await stack.enter_async_context(attacked.http.ws_connect(url))
            for kind, content in moves:
                if kind == "binary":
                    await websocket.send_bytes(content)
                elif kind == "text":
                    await websocket.send_str(content.encode(errors="replace").decode())
                elif kind == "hello":
                    await websocket.send_bytes(fuzzing.packet(0, content))
                elif kind == "reconnect":
                    websocket = await stack.enter_async_context(attacked.http.ws_connect(url))
                else:
                    await send_raw(leader.port, content)
                await asyncio.sleep(0.001)
        except (ConnectionError, aiohttp.ClientError):
            pass  # it may cut off who behaves so


async def send_raw(port, content):
    _, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(content)
    with contextlib.suppress(ConnectionError):
        await writer.drain()
    writer.close()
    with contextlib.suppress(ConnectionError):
        await writer.wait_closed()


async def serve_a_good_one(attacked):
    """Whatever went before, the next follower is served."""
    leader = await attacked.ready()
    async with asyncio.timeout(30):
        while leader.status().phase == "streaming":  # until the bad one's place is free
            await asyncio.sleep(0.002)
            leader = await attacked.ready()
    taken = leader.status().frames
    hello = FollowerHello(channels=NAMES, source="good", extra=attacked.extra)
    client = FollowerClient(
        f"http://127.0.0.1:{leader.port}", hello, FollowerEvents(on_commands=lambda *_: None)
    )
    await client.connect(20.0)
    try:
        frames = np.zeros(3, CHANNELS)
        frames["sequence"] = range(3)
        frames["force_n"] = 50.0
        frames["acceleration_m_s2"] = 1e5
        client.send_frames(frames)
        async with asyncio.timeout(30):
            while leader.status().frames < taken + 3:
                await asyncio.sleep(0.002)
        await asyncio.sleep(0.005)  # some ticks, which render and show what came
    finally:
        await client.disconnect()
    assert not leader.ending.reached


@pytest.fixture(scope="module")
def runner():
    with asyncio.Runner() as made:
        yield made


@pytest.mark.parametrize("method", ["streamed", "passive", "model"])
def test_nothing_that_anybody_sends_ends_the_leader_or_leaves_its_limits(
    method, runner, tmp_path, caplog
):
    attacked = Attacked(tmp_path, method)
    process = psutil.Process()
    runner.run(serve_a_good_one(attacked))
    before_mb = process.memory_info().rss / 1e6

    def example(polite, moves):
        caplog.clear()
        first = [("hello", {**HELLO, "extra": attacked.extra})] if polite else []
        runner.run(attack(attacked, [*first, *moves]))
        runner.run(serve_a_good_one(attacked))

    try:
        assert fuzzing.fuzz(example, st.booleans(), st.lists(MOVES, max_size=10)) >= 10
    finally:
        runner.run(attacked.close())
    assert process.memory_info().rss / 1e6 - before_mb < MOST_GROWTH_MB


def test_whatever_arrives_is_read_or_counted():
    reader, now_ns = BlockReader(CHANNELS, "frames"), 10**10

    def example(message, arguments, frames, silence_ns):
        packet = decode_packet(message)
        event = None if packet is None else binary_event(packet)
        assert event is None or (isinstance(event[0], str) and isinstance(event[1], bytes))
        nonlocal now_ns
        now_ns += silence_ns
        for given_arguments in (tuple(arguments), (frames,)):
            block = reader.read(given_arguments, now_ns)
            if block is None:
                continue
            sequences = block["sequence"].astype(np.int64)
            assert (np.diff(sequences) > 0).all()
            for name in ("position_mm", "force_n", "acceleration_m_s2"):
                assert np.isfinite(block[name]).all()
                assert (np.abs(block[name]) <= 1e6).all()
            assert (block["time_ns"] >= 0).all()
        assert 0 <= reader.lost < 2**32
        assert len(reader.rejected) < 20

    silences = st.integers(0, 10**9)
    fuzzing.fuzz(example, fuzzing.BINARY, fuzzing.ARGUMENTS, fuzzing.FRAMES, silences)
