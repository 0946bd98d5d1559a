"""A shared model as the player's texture, kept as the leader has it."""

import asyncio
from collections.abc import Callable

from mmt.texture.model.texture_model import TextureModel
from mmt_share.client import ListenerClient
from mmt_share.player.player import Player
from mmt_share.tables import Listening


class SharedTexture:
    """Listen to a leader's model on behalf of a player.

    Parameters
    ----------
    settings
        Where the model is shared.
    on_event
        Called with a sentence whenever something happens that a person wants to know.

    Raises
    ------
    InputError
        The URL is not valid, or the token or a certificate cannot be read.
    """

    def __init__(self, settings: Listening, on_event: Callable[[str], None]) -> None:
        self._client = ListenerClient(settings, on_event=on_event)
        self._on_event = on_event

    @property
    def name(self) -> str:
        """What the leader calls its session."""
        return self._client.session.get("name") or "shared"

    async def first(self) -> TextureModel:
        """Connect, and wait until there is a model that can be rendered.

        Raises
        ------
        MmtError
            Nobody shares a model there.
        """
        await self._client.connect()
        while True:
            _, model = await self._client.next_state()
            if model is not None:
                return model
            self._on_event("the model is not ready yet: the surface is still being touched")

    async def follow(self, player: Player) -> None:
        """Let the player have each new state of the model, until cancelled."""
        while True:
            _, model = await self._client.next_state()
            if model is not None:
                await asyncio.to_thread(player.use, [model])

    async def close(self) -> None:
        """Leave."""
        await self._client.close()
