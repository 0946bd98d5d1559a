"""A recording that is served while a test looks at it."""

import asyncio
from contextlib import asynccontextmanager

from mmt.web.viewing.server import RecordingServer


@asynccontextmanager
async def serving(recording):
    """Serve a recording; give the page's address."""
    server, address = RecordingServer(recording), asyncio.Queue[str]()
    running = asyncio.create_task(server.run(address.put_nowait))
    asking = asyncio.create_task(address.get())
    await asyncio.wait([running, asking], return_when=asyncio.FIRST_COMPLETED)
    if running.done():  # it has failed: say why
        asking.cancel()
        running.result()
    try:
        yield asking.result()
    finally:
        server.stop()
        await running
