"""Listeners that stay, and others that join and leave, vanish, stall, and send rubbish."""

import asyncio
import random
from collections import Counter
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Final

import aiohttp
import socketio

from mmt.core.errors import MmtError
from mmt_lab.harness.processes import leave_process_session
from mmt_lab.harness.proxy import Proxy
from mmt_share.client import ListenerClient
from mmt_share.messages import SHARING_VERSION
from mmt_share.tables import Listening

STEADY: Final = 5
"""Listeners that stay."""
EVERY_S: Final = 2.0
"""Time from one trouble to the next."""
_STALL_S: Final = 14.0
"""Length of a stall, longer than the leader waits for a listener that reads nothing."""

KINDS: Final = {
    "visits": "listeners that came and left",
    "vanished": "connections cut without a goodbye",
    "stalled": "listeners that took nothing for 14 s",
    "rubbish": "clients that sent what makes no sense",
}
"""Kinds of trouble, with their descriptions."""


class TroubledListeners:
    """The troubles of one run."""

    def __init__(self, url: str, seed: int) -> None:
        self._url, self._target = url, int(url.rpartition(":")[2])
        self._random = random.Random(seed)  # noqa: S311 - no secret
        self._ended = asyncio.Event()
        self.counts: Counter[str] = Counter()

    async def run(self, longest_s: float) -> dict[str, Any]:
        """Make troubles until the end; return counts of each, and of steady ones up to date."""
        asyncio.get_running_loop().call_later(longest_s, self._ended.set)
        steady = [await self._joined(self._url) for _ in range(STEADY)]
        troubles: set[asyncio.Task[None]] = set()
        while not self._ended.is_set():
            kind = self._random.choice(list(KINDS))
            task = asyncio.create_task(self.make(kind))
            troubles.add(task)
            task.add_done_callback(troubles.discard)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._ended.wait(), EVERY_S)
        for task in list(troubles):
            task.cancel()
        await asyncio.gather(*troubles, return_exceptions=True)
        for client in steady:
            await client.close()
        newest = max(client.replica.number for client in steady)
        same = sum(client.replica.number == newest > 0 for client in steady)
        return {"steady": same, **{kind: self.counts[kind] for kind in KINDS}}

    async def make(self, kind: str) -> None:
        """Make one of `KINDS`, and wait until it is over."""
        makers = {
            "visits": self._visit,
            "vanished": self._vanish,
            "stalled": self._stall,
            "rubbish": self._send_rubbish,
        }
        with suppress(MmtError, socketio.exceptions.SocketIOError):  # the session may have ended
            self.counts[kind] += 1
            await makers[kind]()

    def _hear(self, text: str) -> None:
        if "has ended" in text:
            self._ended.set()

    async def _joined(self, url: str) -> ListenerClient:
        client = ListenerClient(Listening(url=url), on_event=self._hear)
        try:
            await client.connect()
        except BaseException:
            await client.close()
            raise
        return client

    async def _visit(self) -> None:
        client = await self._joined(self._url)
        try:
            await asyncio.sleep(self._random.uniform(0.1, 10.0))
        finally:
            await client.close()

    async def _vanish(self) -> None:
        async with Proxy(self._target) as proxy:
            client = await self._joined(f"http://127.0.0.1:{proxy.port}")
            try:
                await asyncio.sleep(self._random.uniform(0.1, 5.0))
                proxy.cut()
            finally:
                await client.close()

    async def _stall(self) -> None:
        async with Proxy(self._target) as proxy:
            client = await self._joined(f"http://127.0.0.1:{proxy.port}")
            try:
                proxy.stall()
                await asyncio.sleep(_STALL_S)
            finally:
                proxy.cut()
                await client.close()

    async def _send_rubbish(self) -> None:
        # the library's own HTTP session stays open if connecting fails or leaving is cut short
        async with aiohttp.ClientSession() as http:
            await self._send_garbage(
                socketio.AsyncClient(serializer="msgpack", reconnection=False, http_session=http)
            )

    async def _send_garbage(self, client: socketio.AsyncClient) -> None:
        hello = {"sharing": SHARING_VERSION, "role": "listener", "name": "rubbish"}
        await client.connect(self._url, auth=hello, transports=["websocket"])
        try:
            for _ in range(2000):
                event = self._random.choice(["again", "have", "frames", ""])
                await client.emit(event, self._random.randbytes(self._random.randrange(5000)))
                if not client.connected:
                    break
                await asyncio.sleep(0.002)
        finally:
            await client.disconnect()


async def make_trouble(pipe: Connection, url: str, longest_s: float, seed: int) -> None:
    """Make troubles until the end of the session or of a time, and send the number of each."""
    leave_process_session()
    pipe.send(await TroubledListeners(url, seed).run(longest_s))
