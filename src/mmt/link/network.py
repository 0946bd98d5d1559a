"""The emulated network of one side: from the scene, and changed live over HTTP."""

import json
from collections.abc import Awaitable, Callable
from typing import Any, Final, Literal

from aiohttp import web

from mmt.core.errors import InputError
from mmt.link.emulation import EmulatedOutbox
from mmt.scene.files import table_from
from mmt.scene.network_table import Network

PATH: Final = "/network"
_MOST_BYTES: Final = 4096


class EmulatedNetwork:
    """What one side does to the messages that it sends.

    Parameters
    ----------
    settings
        The scene's table ``[network]``.
    direction
        "up" for the follower, which sends frames; "down" for the leader, which sends commands.
    seed
        Of the session, for settings without one of their own.
    on_change
        Called with a sentence when the settings have changed.
    """

    def __init__(
        self,
        settings: Network,
        direction: Literal["up", "down"],
        seed: int,
        on_change: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.settings = settings
        self._direction: Literal["up", "down"] = direction
        self._session_seed = seed
        self._on_change = on_change
        self._outboxes: list[EmulatedOutbox] = []

    def outbox(self, capacity: int) -> EmulatedOutbox:
        """Return an outbox for so many messages that follows these settings."""
        outbox = EmulatedOutbox(capacity, self._mine(), self._seed())
        self._outboxes.append(outbox)
        return outbox

    def payload(self) -> dict[str, Any]:
        """Return the settings as the other side and programs take them."""
        return self.settings.model_dump(mode="json")

    def change(self, payload: object) -> None:
        """Check settings that came from elsewhere and take them on.

        Raises
        ------
        InputError
            They are not as the scene's table ``[network]``.
        """
        settings = table_from(Network, "network", payload)
        if settings == self.settings:
            return
        self.settings = settings
        for outbox in self._outboxes:
            outbox.change(self._mine(), self._seed())
        self._on_change(f"emulated network: {settings.describe()}")

    def serve(self, application: web.Application, tell: Callable[[], Awaitable[None]]) -> None:
        """Let programs read and replace the settings; `tell` passes them to the other side."""

        async def read(_: web.Request) -> web.Response:
            return web.json_response(self.payload())

        async def replace(request: web.Request) -> web.Response:
            try:
                self.change(await _json_of(request))
            except InputError as error:
                return web.json_response({"error": str(error)}, status=400)
            await tell()
            return web.json_response(self.payload())

        application.router.add_get(PATH, read)
        application.router.add_put(PATH, replace)

    def _mine(self) -> Network:
        return self.settings if self.settings.concerns(self._direction) else Network()

    def _seed(self) -> int:
        own = self.settings.seed
        seed = self._session_seed if own is None else own
        return 2 * seed + (self._direction == "down")


async def _json_of(request: web.Request) -> object:
    """Return the body; a browser's page of another origin cannot send this content type."""
    if request.content_type != "application/json":
        raise InputError("send the settings as JSON, with Content-Type: application/json")
    body = await request.content.read(_MOST_BYTES + 1)
    if len(body) > _MOST_BYTES:
        raise InputError(f"the settings are longer than {_MOST_BYTES} bytes")
    try:
        return json.loads(body)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the settings are no JSON: {error}") from error
