"""A Redis server of their own, and hubs in this process, for the tests of hubs."""

import asyncio
import os
import shutil
import socket
import subprocess
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass, field

import pytest
from waiting import until

from mmt.cli.running.child import Child
from mmt.core.errors import MmtError
from mmt_share.hub.scene import HubScene
from mmt_share.hub.service import Hub

REDIS_SERVER = shutil.which("redis-server")

needs_redis = pytest.mark.skipif(REDIS_SERVER is None, reason="redis-server is not installed")


@dataclass
class RedisServer:
    """A Redis server that keeps nothing, as a process of its own."""

    port: int
    options: tuple[str, ...] = ()
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        return f"redis://127.0.0.1:{self.port}"

    def start(self):
        assert REDIS_SERVER is not None
        self.process = subprocess.Popen(
            [
                *(REDIS_SERVER, "--port", str(self.port), "--bind", "127.0.0.1"),
                *("--save", "", "--appendonly", "no", *self.options),
            ],
            stdout=subprocess.DEVNULL,
        )
        until(self.answers)

    def answers(self):
        with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1.0):
            return True
        return False

    def kill(self):
        process, self.process = self.process, None
        if process is not None:
            process.kill()
            process.wait(60.0)


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def redis_server(*options):
    server = RedisServer(free_port(), options)
    server.start()
    try:
        yield server
    finally:
        server.kill()


@dataclass
class Served:
    """A hub that runs in this process."""

    hub: Hub
    said: list[str]
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    running: asyncio.Task[None] | None = None

    @property
    def url(self) -> str:
        return self.hub.address

    async def ends_by(self, sentence):
        """Wait until it has ended by an error that says so."""
        assert self.running is not None
        with pytest.raises(MmtError, match=sentence):
            await self.running
        self.running = asyncio.create_task(asyncio.sleep(0))


@asynccontextmanager
async def serving(leader, redis, **tables):
    """Run a hub of a leader until the end of the block."""
    said = []
    scene = HubScene.model_validate(
        {
            "hub": {"redis": redis, **tables.get("hub", {})},
            "sharing": {"port": 0, **tables.get("sharing", {})},
            "listening": {"url": leader, "patience_s": 5.0, **tables.get("listening", {})},
        }
    )
    hub = Hub(scene, lambda port: f"http://127.0.0.1:{port}", said.append)
    served = Served(hub, said)
    try:
        await hub.start()
        served.running = asyncio.create_task(hub.run(served.ended))
        yield served
        served.ended.set()
        await served.running
    finally:
        if served.running is not None:
            served.running.cancel()
            await asyncio.gather(served.running, return_exceptions=True)
        await hub.stop()


@asynccontextmanager
async def hub_process(leader, redis):
    """Run ``mmt hub`` until the end of the block; give the process and where it listens."""
    arguments = ["main", "hub", leader, "--redis", redis, "--port", "0", "--json-lines"]
    environment = {**os.environ, "MMT_LISTENING__NAME": "hub"}
    child = await Child.start("hub", "mmt.cli.running.child", arguments, environment)
    lines = child.lines()
    try:
        async for line in lines:
            if line["kind"] == "ready":
                yield child, line["address"]
                break
        else:
            raise RuntimeError(child.messages)
    finally:
        await child.kill()
        async for _ in lines:  # to its end, so that the pipe is closed
            pass
