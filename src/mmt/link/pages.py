"""Pages that a service serves beside its link: health and metrics."""

import asyncio
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from aiohttp import web

from mmt.link.access import Access

if TYPE_CHECKING:
    from prometheus_client import CollectorRegistry

Page = Callable[[web.Application, Access], None]
"""Adds itself to an application; what it shows to whom is by the access."""


def health_page(read: Callable[[], Mapping[str, Any]]) -> Page:
    """Return the page ``/health``: 200 where the key ``faults`` is empty, else 503.

    Who has not the token, where there is one, learns but whether all is well.
    """

    def add(application: web.Application, access: Access) -> None:
        async def health(request: web.Request) -> web.Response:
            table = read()
            good = not table["faults"]
            trusted = access.admits_header(request.headers.get("Authorization"))
            content = {"ok": good, **(table if trusted else {})}
            return web.json_response(content, status=200 if good else 503)

        application.router.add_get("/health", health)

    return add


def metrics_page(registry: "CollectorRegistry") -> Page:
    """Return the page ``/metrics`` for Prometheus, made in a thread, one at a time."""
    from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest

    def add(application: web.Application, _: Access) -> None:
        one = asyncio.Lock()

        async def metrics(_: web.Request) -> web.Response:
            async with one:
                text = await asyncio.to_thread(generate_latest, registry)
            return web.Response(body=text, headers={"Content-Type": CONTENT_TYPE_LATEST})

        application.router.add_get("/metrics", metrics)

    return add
