"""A shared model as the player's texture, kept up to date."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt_share.client import ListenerClient
from mmt_share.messages import STATE, STATE_DTYPE, WELCOME
from mmt_share.player.player import Player
from mmt_share.player.results import ResultsFile
from mmt_share.tables import Listening

_HAND_HZ: Final = 10.0


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
        self._client = ListenerClient(
            settings,
            on_event=self._say,
            on_message=self._take,
            states_hz=_HAND_HZ,
        )
        self._on_event = on_event
        self._welcomed = asyncio.Event()
        self._said = ""
        self._player: Player | None = None

    async def connect(self, results: ResultsFile) -> Player:
        """Connect, and return a player of the surface; `follow` gives it the model.

        Raises
        ------
        MmtError
            Nobody shares a model there.
        """
        await self._client.connect()
        await self._welcomed.wait()
        name = self._client.session.get("name") or "shared"
        self._player = Player([name], [], results=results, scenarios=False)
        self._player.said = self._said
        return self._player

    async def follow(self, player: Player) -> None:
        """Give the player each new state of the model, until cancelled."""
        while True:
            about, model = await self._client.next_state()
            player.completion = about.completion
            if model is None:
                continue
            try:
                await asyncio.to_thread(player.set_models, [model])
            except InputError as error:
                self._say(str(error))

    async def close(self) -> None:
        """Disconnect from the leader."""
        await self._client.close()

    def _say(self, sentence: str) -> None:
        self._said = sentence
        if self._player is not None:
            self._player.said = sentence
        self._on_event(sentence)

    def _take(self, event: str, message: Any) -> None:
        if event == WELCOME:
            self._welcomed.set()
        elif event == STATE and self._player is not None:
            state = np.frombuffer(message, STATE_DTYPE)[0]
            x_mm, y_mm, _ = (float(at) for at in state["position_mm"])
            self._player.hand = (x_mm, y_mm, bool(state["contact"]))
