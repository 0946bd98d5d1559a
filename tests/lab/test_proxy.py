"""The proxy between services: it passes, stalls and cuts, and loses nothing."""

import asyncio
import socket
from contextlib import asynccontextmanager, suppress

from mmt_lab.harness.proxy import Proxy


async def close(writer):
    writer.close()
    with suppress(ConnectionError):
        await writer.wait_closed()


async def is_closed(reader):
    try:
        return await reader.read(100) == b""
    except ConnectionError:
        return True


async def called(proxy):
    return await asyncio.open_connection("127.0.0.1", proxy.port)


@asynccontextmanager
async def proxy_to_shouter():
    """A proxy to a server that answers in capitals; the semaphore counts what has ended there."""
    ended = asyncio.Semaphore(0)

    async def shout(reader, writer):
        with suppress(ConnectionError):
            while data := await reader.read(65_536):
                writer.write(data.upper())
        await close(writer)
        ended.release()

    server = await asyncio.start_server(shout, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    async with asyncio.timeout(60), server, Proxy(port) as proxy:
        yield proxy, ended


async def test_a_proxy_passes_stalls_and_cuts():
    async with proxy_to_shouter() as (proxy, ended):
        reader, writer = await called(proxy)
        writer.write(b"one")
        assert await reader.read(100) == b"ONE"
        proxy.stall()
        writer.write(b"two")
        waiting = asyncio.create_task(reader.read(100))
        done, _ = await asyncio.wait([waiting], timeout=0.2)
        assert not done
        proxy.resume()
        assert await waiting == b"TWO"
        proxy.cut()
        assert await is_closed(reader)
        await ended.acquire()
        await close(writer)
        reader, writer = await called(proxy)
        writer.write(b"three")
        assert await reader.read(100) == b"THREE"
        await close(writer)
        await ended.acquire()


async def test_a_proxy_without_a_target_ends_its_connections():
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    async with asyncio.timeout(20), Proxy(port) as proxy:
        reader, writer = await called(proxy)
        assert await is_closed(reader)
        await close(writer)
