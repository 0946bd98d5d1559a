"""A browser without a screen, at the monitor of a leader that runs."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aiohttp
from monitor_messages import unpack
from service_runs import Together, small_scene


@dataclass
class Browser:
    """Opens sockets as the page does."""

    http: aiohttp.ClientSession
    sockets: list[aiohttp.ClientWebSocketResponse] = field(default_factory=list)

    async def look_on(
        self, together: Together, token: str | None = None
    ) -> aiohttp.ClientWebSocketResponse:
        socket = await self.http.ws_connect(address(together))
        self.sockets.append(socket)
        await socket.send_str(json.dumps({"token": token}))
        return socket


@asynccontextmanager
async def open_browser() -> AsyncIterator[Browser]:
    async with aiohttp.ClientSession() as session:
        browser = Browser(session)
        yield browser
        for socket in browser.sockets:
            await socket.close()


async def monitored(directory: Path, **tables: dict[str, Any] | None) -> Together:
    scene = small_scene(directory, monitor={"updates_hz": 50}, **tables)
    return await Together.listening(scene)


def address(together: Together, path: str = "/monitor/socket") -> str:
    return f"http://127.0.0.1:{together.leader.port}{path}"


async def until(socket: aiohttp.ClientWebSocketResponse, kind: str) -> dict[str, Any]:
    """Return the next message of a kind."""
    async with asyncio.timeout(30):
        while True:
            message = unpack(await socket.receive_bytes())
            if message["kind"] == kind:
                return message
