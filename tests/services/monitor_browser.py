"""A browser without a screen, at the monitor of a leader that runs."""

import json
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import aiohttp
from service_runs import Together, small_scene


@dataclass
class Browser:
    """Opens sockets as the page does."""

    http: aiohttp.ClientSession
    sockets: list[aiohttp.ClientWebSocketResponse] = field(default_factory=list)

    async def look_on(self, together, token=None):
        socket = await self.http.ws_connect(address(together))
        self.sockets.append(socket)
        await socket.send_str(json.dumps({"token": token}))
        return socket


@asynccontextmanager
async def open_browser():
    async with aiohttp.ClientSession() as session:
        browser = Browser(session)
        yield browser
        for socket in browser.sockets:
            await socket.close()


async def monitored(directory, **tables):
    scene = small_scene(directory, monitor={"updates_hz": 50}, **tables)
    return await Together.listening(scene)


def address(together, path="/monitor/socket"):
    return f"http://127.0.0.1:{together.leader.port}{path}"
