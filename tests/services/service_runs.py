"""Both services in one event loop, on whatever a test wants to stream."""

import asyncio
from dataclasses import dataclass, field

import numpy as np
from frame_samples import made_frames

from mmt.core.arrays import RecordArray
from mmt.core.frames import CHANNELS, frame_dtype
from mmt.follower import service as follower_service
from mmt.follower.service import Follower
from mmt.leader.reports import LeaderSummary
from mmt.leader.service import Leader
from mmt.link.client import FollowerClient
from mmt.link.endpoint import FollowerEvents
from mmt.link.protocol import FollowerHello
from mmt.link.server import LeaderServer
from mmt.scene.files import scene_from_tables

LONGEST_S = 60.0
"""No wait lasts longer."""


def small_scene(directory, **tables):
    """A scene that streams and records; tables are added, replaced, or left out (None)."""
    base = {
        "link": {"port": 0, "patience_s": 0.5},
        "simulated": {},
        "hand": {},
        "playout": {},
        "actuator": {},
        "recording": {"file": str(directory / "session.mcap")},
    }
    chosen = {**base, **tables}
    return scene_from_tables({name: table for name, table in chosen.items() if table is not None})


@dataclass
class MadeSource:
    """Streams one block a tick, then ends, or raises an error."""

    blocks: list[RecordArray]
    error: Exception | None = None
    finished: bool = False
    annotations: bytes = b"as made"
    closed: bool = False
    close_error: Exception | None = None

    def start(self, start_time_ns):
        pass

    def step(self, elapsed, now_ns, command_position_mm):
        if self.blocks:
            return self.blocks.pop(0)
        if self.error is not None:
            raise self.error
        self.finished = True
        return np.zeros(0, frame_dtype())

    def describe(self):
        return "made for a test"

    def close(self):
        self.closed = True
        if self.close_error is not None:
            raise self.close_error


def endless():
    """Stream made frames for longer than any test, one a tick."""
    return MadeSource([made_frames(number, 1) for number in range(20_000)])


@dataclass
class Together:
    """A leader and the followers that are started for it; collects what both say."""

    leader: Leader
    said: list[str] = field(default_factory=list)
    _leading: "asyncio.Task[LeaderSummary] | None" = None

    @classmethod
    def of(cls, scene):
        said = []
        return cls(Leader(scene, on_event=said.append), said)

    @classmethod
    async def listening(cls, scene):
        """Start a leader, and wait until it is ready, or has failed."""
        together = cls.of(scene)
        await together.listen()
        return together

    @property
    def server(self) -> LeaderServer:
        """The leader's side of the link, once it listens."""
        assert self.leader.remote is not None
        return self.leader.remote.server

    async def listen(self):
        """Start the leader and wait until it is ready, or has failed."""
        ready = asyncio.Event()
        self._leading = asyncio.create_task(self.leader.run(ready.set))
        waiting = asyncio.create_task(ready.wait())
        first = asyncio.FIRST_COMPLETED
        await asyncio.wait([self._leading, waiting], timeout=LONGEST_S, return_when=first)
        waiting.cancel()

    async def follow(self, source=None, scene=None):
        """Run a follower to its end; it streams the scene's own source if none is given."""
        return await self.follower(source, scene).run()

    def follower(self, source=None, scene=None):
        """Make a follower that will connect to the leader."""
        build = follower_service.build_source
        if source is not None:
            follower_service.build_source = lambda _: source
        try:
            return Follower(
                scene or self.leader.scene,
                f"http://127.0.0.1:{self.leader.port}",
                on_event=lambda sentence: self.said.append(f"follower: {sentence}"),
            )
        finally:
            follower_service.build_source = build

    async def client(self, **hello):
        """Connect a follower's side of the link alone, which a test sends frames with."""
        client = FollowerClient(
            f"http://127.0.0.1:{self.leader.port}",
            FollowerHello(**{"channels": CHANNELS, "source": "test", **hello}),
            FollowerEvents(on_commands=lambda *_: None),
        )
        await client.connect(10.0)
        return client

    async def end(self):
        """Wait for the leader's end."""
        assert self._leading is not None
        async with asyncio.timeout(LONGEST_S):
            return await self._leading

    async def stop(self):
        """End the leader, and wait for its end."""
        self.leader.stop()
        return await self.end()

    async def until(self, happened):
        """Wait until something is true, while the leader runs."""
        assert self._leading is not None
        async with asyncio.timeout(LONGEST_S):
            while not happened():
                assert not self._leading.done(), self.said
                await asyncio.sleep(0.005)


async def run_session(scene, source):
    """Run both to their end."""
    together = await Together.listening(scene)
    followed = await together.follow(source)
    return await together.end(), followed
