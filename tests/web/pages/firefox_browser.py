"""Firefox for the pages' tests, by WebDriver BiDi (W3C): its own remote agent speaks it."""

import asyncio
import itertools
import json
import re
import shutil
from contextlib import asynccontextmanager

import aiohttp

FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox")


class FirefoxPage:
    """The window of a Firefox; its `evaluate` is that of playwright."""

    def __init__(self, socket):
        self._socket, self._numbers = socket, itertools.count()
        self.window = ""
        self.problems = []
        """Errors on the console."""

    async def tell(self, method, **parameters):
        """Give a command; return its result."""
        number = next(self._numbers)
        await self._socket.send_json({"id": number, "method": method, "params": parameters})
        async with asyncio.timeout(60.0):
            while (answer := await self._socket.receive_json()).get("id") != number:
                if answer["params"].get("level") == "error":
                    self.problems.append(answer["params"]["text"])
        assert answer["type"] == "success", answer
        return answer["result"]

    async def goto(self, url, width):
        where = {"context": self.window}
        view = {"width": width, "height": 800}
        await self.tell("browsingContext.setViewport", **where, viewport=view)
        await self.tell("browsingContext.navigate", **where, url=url, wait="complete")

    async def evaluate(self, script, given=None):
        call = f"await (typeof it === 'function' ? it({json.dumps(given)}) : it)"
        expression = f"(async (it) => JSON.stringify({call} ?? null))({script})"
        where = {"target": {"context": self.window}, "awaitPromise": True}
        said = await self.tell("script.evaluate", expression=expression, **where)
        return json.loads(said["result"]["value"])

    async def act(self, kind, *actions):
        """Move, press and lift a pointer: "mouse", "pen" or "touch"."""
        source = {"type": "pointer", "id": kind, "parameters": {"pointerType": kind}}
        sources = [{**source, "actions": actions}]
        await self.tell("input.performActions", context=self.window, actions=sources)


@asynccontextmanager
async def a_firefox(profile):
    command = (str(FIREFOX), "--headless", "--remote-debugging-port", "0", "--profile", profile)
    process = await asyncio.create_subprocess_exec(*command, stderr=asyncio.subprocess.PIPE)
    assert process.stderr is not None
    try:
        async with asyncio.timeout(60.0):
            while not (at := re.search(rb"BiDi .*(ws://\S+)", await process.stderr.readline())):
                assert process.returncode is None
        address = f"{at[1].decode()}/session"
        async with aiohttp.ClientSession() as http, http.ws_connect(address) as socket:
            page = FirefoxPage(socket)
            await page.tell("session.new", capabilities={})
            await page.tell("session.subscribe", events=["log.entryAdded"])
            tree = await page.tell("browsingContext.getTree")
            page.window = tree["contexts"][0]["context"]
            yield page
    finally:
        process.kill()
        await process.wait()
