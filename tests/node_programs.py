"""Client programs in another language: npm's stock socket.io-client under Node."""

import asyncio
import os
import re
import shutil
import sys
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from aiohttp import web
from aiohttp.test_utils import TestServer

MODULES = Path(sys.prefix) / "node" / "node_modules"
NODE = shutil.which("node")
LONGEST_S = 60.0
TOKEN = "sixteen-characters"

NEEDS_NODE = [
    pytest.mark.skipif(NODE is None, reason="Node is not installed"),
    pytest.mark.skipif(
        not (MODULES / "socket.io-msgpack-parser").is_dir(),
        reason=f"socket.io-client is not in {MODULES}: scripts/test puts it there by npm",
    ),
]
"""Marks of the modules whose tests run these programs."""


async def run_node(program, *arguments):
    """Run a program; return its exit code, and what it prints and complains of."""
    process = await asyncio.create_subprocess_exec(
        *(str(NODE), str(program), *map(str, arguments)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        env={**os.environ, "NODE_PATH": str(MODULES)},
    )
    printed, complaints = await asyncio.wait_for(process.communicate(), LONGEST_S)
    return process.returncode or 0, printed.decode(), complaints.decode()


PAGE = Path(__file__).parents[1] / "docs/how-to/javascript.md"


def documented(heading):
    """The program that the documentation has under a heading; "" for what Node begins with."""
    text = PAGE.read_text(encoding="utf-8").partition(f"## {heading}" if heading else "# ")[2]
    found = re.search(r"```js\n(.*?)```", text, re.DOTALL)
    return found.group(1)


def under_node(folder, heading, url, last):
    """That program as a file for Node, for a leader at this address, with a last line."""
    begin = re.sub(r'address = ".*?"', f'address = "{url}"', documented(""))
    program = folder / "program.cjs"
    program.write_text(f"{begin}{documented(heading)}{last}\n", encoding="utf-8")
    return program


@asynccontextmanager
async def another_site(folder):
    """What lets pages of another site connect, and what shows such a page in Chromium.

    It runs the program of that heading, with the token, for the leader at an address.
    """
    api = pytest.importorskip("playwright.async_api", reason="playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is not installed")
    token = folder / "token"
    token.write_text(TOKEN, encoding="utf-8")
    token.chmod(0o600)
    bundle = MODULES / "socket.io-client/dist/socket.io.msgpack.min.js"
    text = ""

    async def answer(_):
        return web.Response(text=text, content_type="text/html")

    app = web.Application()
    app.router.add_get("/", answer)
    async with TestServer(app) as site, api.async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])

        async def show(address, heading):
            nonlocal text
            begin = f"const options = {{}}, address = '{address}';"
            program = documented(heading).replace("auth: {", f"auth: {{ token: '{TOKEN}',")
            scripts = (bundle.read_text(encoding="utf-8"), begin, program)
            text = "<!doctype html>" + "".join(f"<script>{script}</script>" for script in scripts)
            page = await browser.new_page()
            said = []
            page.on(
                "console",
                lambda message: said.append(message.text) if message.type == "log" else None,
            )
            await page.goto(str(site.make_url("/")))
            return page, said

        origin = str(site.make_url("/")).rstrip("/")
        yield {"token_file": str(token), "allow_origins": [origin]}, show
        await browser.close()
