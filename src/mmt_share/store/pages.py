"""HTTP pages of a store, at the port of the shared model; ``docs/reference/sharing.md``."""

import asyncio
from typing import TYPE_CHECKING, Final

from aiohttp import web

from mmt.core.errors import InputError, MmtError
from mmt_share.store.store import HASH, LARGEST_BYTES, Entry, ModelStore

if TYPE_CHECKING:
    from mmt.link.access import Access
    from mmt.link.serving.http import Page

MODELS: Final = "/models"


def store_pages(store: ModelStore, *, accepts: bool) -> "Page":
    """Return the pages that list the store, serve its models and, if it `accepts`, add models."""

    async def listed(_: web.Request) -> web.Response:
        entries = await asyncio.to_thread(store.entries)
        return web.json_response([vars(entry) for entry in entries])

    async def fetched(request: web.Request) -> web.StreamResponse:
        path = store.path(request.match_info["digest"])
        if path is None:
            return web.Response(status=404, text="there is no model of this hash\n")
        return web.FileResponse(path, headers={"Content-Type": "application/octet-stream"})

    async def pushed(request: web.Request) -> web.Response:
        try:
            description = Entry.from_description(request.query)
            entry = await asyncio.to_thread(store.add, await request.read(), description)
        except InputError as error:
            return web.Response(status=400, text=f"{error}\n")
        except (OSError, MmtError) as error:
            return web.Response(status=507, text=f"it cannot be stored: {error}\n")
        return web.json_response(vars(entry))

    async def refused(_: web.Request) -> web.Response:
        return web.Response(status=403, text="it takes no models: set accept of its [sharing]\n")

    def add(application: web.Application, _: "Access") -> None:
        library = web.Application(client_max_size=LARGEST_BYTES + 1)
        library.router.add_get("", listed)
        library.router.add_get(f"/{{digest:{HASH}}}", fetched)
        library.router.add_post("", pushed if accepts else refused)
        application.add_subapp(MODELS, library)

    return add
