"""A shared model as the player's texture, kept up to date."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt_share.client import ListenerClient
from mmt_share.messages import STATE, STATE_DTYPE, WELCOME
from mmt_share.player.player import Player
from mmt_share.player.results import ResultsFile
from mmt_share.tables import Listening

_HAND_HZ: Final = 10.0


@asynccontextmanager
async def shared_player(
    settings: Listening, results: ResultsFile, on_event: Callable[[str], None]
) -> AsyncIterator[Player]:
    """Yield a player of the surface that a leader shares; it follows the model in the block.

    Parameters
    ----------
    settings
        Where the model is shared.
    results
        As of `Player`.
    on_event
        Called with a sentence whenever something happens that a person wants to know.

    Raises
    ------
    InputError
        The URL is not valid, or the token or a certificate cannot be read.
    MmtError
        Nobody shares a model there.
    """
    player = Player(["shared"], [], results=results, scenarios=False)
    welcomed = asyncio.Event()

    def say(sentence: str) -> None:
        player.said = sentence
        on_event(sentence)

    def take(event: str, message: Any) -> None:
        if event == WELCOME and not welcomed.is_set():
            player.names = (client.session["name"] or "shared",)
            welcomed.set()
        elif event == STATE:
            state = np.frombuffer(message, STATE_DTYPE)[0]
            x_mm, y_mm, _ = (float(at) for at in state["position_mm"])
            player.hand = (x_mm, y_mm, bool(state["contact"]))

    client = ListenerClient(settings, on_event=say, on_message=take, states_hz=_HAND_HZ)
    following = asyncio.create_task(_follow(client, player, say))
    try:
        await client.connect()
        await welcomed.wait()
        yield player
    finally:
        following.cancel()
        await client.close()


async def _follow(client: ListenerClient, player: Player, say: Callable[[str], None]) -> None:
    """Give the player each new state of the model, until cancelled."""
    while True:
        about, model = await client.next_state()
        player.completion = about.completion
        if model is not None:
            try:
                await asyncio.to_thread(player.set_models, [model])
            except InputError as error:
                say(str(error))
