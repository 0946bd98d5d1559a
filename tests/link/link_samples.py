"""Blocks, and a leader and a follower that note what they are told."""

import asyncio
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace

import numpy as np
import socketio

from mmt.core.arrays import RecordArray
from mmt.core.frames import COMMAND_DTYPE, FIELD_OF_CHANNEL, channels_of, frame_dtype
from mmt.core.running.process import clock_id
from mmt.link.client import FollowerClient
from mmt.link.clock_offset import ClockJump
from mmt.link.emulated.network import EmulatedNetwork
from mmt.link.endpoint import FollowerEvents, LeaderEvents
from mmt.link.protocol import FollowerHello
from mmt.link.server import LeaderServer
from mmt.scene import Link, Network

CHANNELS = ("position", "force")
WEBSOCKET = b"GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\n"
UPGRADE = WEBSOCKET + (
    b"Host: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MTIzNDU2Nzg5MDEyMzQ1Ng==\r\n\r\n"
)
"""What a client asks a leader for: its first line, and all of it."""


def frames(first, count=1, time_ns=1):
    block = np.zeros(count, dtype=frame_dtype(CHANNELS))
    block["sequence"] = np.arange(first, first + count)
    block["time_ns"] = time_ns
    block["position_mm"] = block["sequence"][:, None] + np.array([0.25, 0.5, 0.75])
    block["force_n"] = -1.5
    return block


def drawn_frames(first, count, dtype, seed=1):
    """Frames of any layout with numbers of their own in every place."""
    random = np.random.default_rng([seed, first])
    block = np.zeros(count, dtype=dtype)
    block["sequence"] = np.arange(first, first + count)
    block["time_ns"] = block["sequence"].astype(np.int64) * 1_000_000
    for channel in channels_of(dtype):
        values = block[FIELD_OF_CHANNEL[channel]]
        block[FIELD_OF_CHANNEL[channel]] = random.normal(0.0, 100.0, values.shape)
    return block


def commands(first, count=1, time_ns=1):
    block = np.zeros(count, dtype=COMMAND_DTYPE)
    block["sequence"] = np.arange(first, first + count)
    block["time_ns"] = time_ns
    block["position_mm"] = 2.5
    return block


def hello(**changes):
    values = {"channels": CHANNELS, "source": "test", **changes}
    return FollowerHello(**values)


@dataclass
class Notes:
    """What both sides are told."""

    blocks: list[RecordArray] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    errors: list[Exception] = field(default_factory=list)

    @property
    def sequences(self) -> list[int]:
        return [int(sequence) for block in self.blocks for sequence in block["sequence"]]


@dataclass
class LeaderNotes(Notes):
    hellos: list[FollowerHello] = field(default_factory=list)
    ends: list[str] = field(default_factory=list)

    def events(self):
        return LeaderEvents(
            on_frames=lambda block, arrival_ns: self.blocks.append(block),
            on_follower=self.hellos.append,
            on_end=self.ends.append,
            on_lost=self.losses.append,
            on_error=self.errors.append,
        )


@dataclass
class FollowerNotes(Notes):
    stops: list[str] = field(default_factory=list)

    def events(self):
        return FollowerEvents(
            on_commands=lambda block, arrival_ns: self.blocks.append(block),
            on_stop=self.stops.append,
            on_lost=self.losses.append,
            on_error=self.errors.append,
        )


@asynccontextmanager
async def leader(notes=None, events=None, channels=CHANNELS, *, made=(), **link):
    """A leader; `made` is what its server is made of besides."""
    events = events or (notes or LeaderNotes()).events()
    server = LeaderServer(Link(**{"port": 0, **link}), channels, events, **dict(made))
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


@asynccontextmanager
async def follower(
    where, notes=None, access=None, *, events=None, made=(), timeout_s=30.0, **changes
):
    """A follower at a port or URL; `made` is what its client is made of besides."""
    url = where if isinstance(where, str) else f"http://127.0.0.1:{where}"
    events = events or (notes or FollowerNotes()).events()
    client = FollowerClient(url, hello(**changes), events, access=access, **dict(made))
    try:
        await client.connect(timeout_s)
        yield client
    finally:
        await client.disconnect()


@asynccontextmanager
async def stock_client(port, token=None, **changes):
    """python-socketio's own client in the follower's place."""
    client = socketio.AsyncClient(serializer="msgpack", handle_sigint=False, reconnection=False)
    auth = {**hello(**changes).to_auth(), "token": token}
    await client.connect(f"http://127.0.0.1:{port}", auth=auth, transports=["websocket"])
    try:
        yield client
    finally:
        await client.disconnect()


@dataclass
class Linked:
    """A leader and a follower on an emulated network, and what they are told."""

    server: LeaderServer
    client: FollowerClient
    leads: EmulatedNetwork
    follows: EmulatedNetwork
    up: LeaderNotes
    down: FollowerNotes
    said: list[str]
    jumps: list[tuple[str, ClockJump]]


@asynccontextmanager
async def linked(clock_hz=0.0, other=None, **network):
    """Both sides on one network; `other` stands for the clock of another machine."""
    up, down, said, jumps = LeaderNotes(), FollowerNotes(), [], []
    leads, follows = (
        EmulatedNetwork(Network(**network), way, 1, said.append) for way in ("down", "up")
    )
    above, below = (
        replace(notes.events(), on_jump=lambda jump, side=side: jumps.append((side, jump)))
        for notes, side in ((up, "leader"), (down, "follower"))
    )
    made = {"network": follows, "clock_hz": clock_hz}
    async with (
        leader(events=above, made={"network": leads}) as server,
        follower(server.port, events=below, made=made, clock_id=other or clock_id()) as client,
    ):
        await until(lambda: server.can_send)
        yield Linked(server, client, leads, follows, up, down, said, jumps)


async def until(condition, timeout_s=30.0):
    """Wait until the condition holds."""
    async with asyncio.timeout(timeout_s):
        while not condition():
            await asyncio.sleep(0.002)
