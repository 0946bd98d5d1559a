"""A recording that is served while a test looks at it."""

import asyncio
from contextlib import asynccontextmanager

from mmt.web.viewing.server import serve_recording


@asynccontextmanager
async def serving(recording):
    """Serve a recording; give the page's address."""
    ended, address = asyncio.Event(), asyncio.Queue[str]()
    running = asyncio.create_task(serve_recording(recording, 0, ended, address.put_nowait))
    asking = asyncio.create_task(address.get())
    await asyncio.wait([running, asking], return_when=asyncio.FIRST_COMPLETED)
    if running.done():  # it has failed: say why
        asking.cancel()
        running.result()
    try:
        yield asking.result()
    finally:
        ended.set()
        await running
