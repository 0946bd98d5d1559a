"""A listener's side: connected to whoever shares a model, with a copy that is kept up to date."""

import asyncio
import logging
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.errors import InputError
from mmt.link.access import Access
from mmt.link.connection import Connection
from mmt.link.protocol import peer_text
from mmt.link.rate_limit import RateLimit
from mmt.link.websocket import Send
from mmt.scene.sharing_tables import Listening
from mmt.sharing.messages import (
    AGAIN,
    CHANGE,
    END,
    LONGEST_MESSAGE,
    MODEL,
    SHARING_VERSION,
    STATE,
    STATE_DTYPE,
    TOKEN_VARIABLE,
    WELCOME,
    Hello,
)
from mmt.sharing.replica import ModelReplica

LOG: Final = logging.getLogger("mmt.sharing")

_MESSAGES_HZ: Final = 50.0
"""500 messages a second may come, and 1 MB: more than any leader sends."""


class ListenerClient:
    """Connect to a shared model, and keep a copy of it.

    Parameters
    ----------
    settings
        The scene's ``[listening]``.
    on_model
        Called when the copy has changed.
    on_state
        Called with the newest state of the hand that strokes, a record of `STATE_DTYPE`.
    on_event
        Called with a sentence whenever something happens that a person wants to know.

    Raises
    ------
    InputError
        The URL is not valid, or the token or a certificate cannot be read.
    """

    def __init__(
        self,
        settings: Listening,
        *,
        on_model: Callable[[], None],
        on_state: Callable[[RecordArray], None] = lambda _: None,
        on_event: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.replica = ModelReplica()
        self.session: dict[str, Any] = {}
        """What the leader said of its session."""
        self.wholes = self.changes = self.states = 0
        """Messages taken."""
        self.rejected = 0
        self._settings = settings
        self._on_model, self._on_state, self._on_event = on_model, on_state, on_event
        self._asked = False
        self._asking: asyncio.Task[None] | None = None
        self._connection = Connection(
            settings.url,
            Hello(settings.name or "").as_auth(),
            Access.of(settings, variable=TOKEN_VARIABLE),
            RateLimit(_MESSAGES_HZ, lambda _: None, lambda _: None),
            on_open=self._on_open,
            on_broken=self._on_broken,
            role="listener",
            tables="[sharing] there and [listening] here",
            longest_message=LONGEST_MESSAGE,
        )

    @property
    def connected(self) -> bool:
        """Whether the leader is there."""
        return self._connection.connected

    async def connect(self) -> None:
        """Connect; a connection that breaks is restored until `close`.

        Raises
        ------
        MmtError
            Nobody answered within ``patience_s``, or the listener was refused; the message says
            why.
        """
        handlers: dict[str, Callable[..., None]] = {
            WELCOME: self._welcome,
            MODEL: self._take_whole,
            CHANGE: self._take_change,
            END: self._take_end,
        }
        await self._connection.open(handlers, {STATE: self._take_state}, self._settings.patience_s)

    async def close(self) -> None:
        """Leave."""
        await self._connection.close()

    # --- what comes

    def _on_open(self, _: Send) -> None:
        self._asked = False

    def _on_broken(self, reason: str) -> None:
        self._on_event(f"the leader's model is cut off ({reason}): the last state stays")

    def _welcome(self, message: object = None, *_: object) -> None:
        if not isinstance(message, Mapping) or message.get("sharing") != SHARING_VERSION:
            self._on_event("what answers shares no model of this version: nothing is taken from it")
            return
        self.session = {
            name: peer_text(str(message.get(name, ""))) for name in ("session_id", "name")
        }
        self._on_event(f"listening to {self.session['name'] or 'a session'}")
        self._ask()

    def _take_whole(self, message: object = None, *_: object) -> None:
        self._asked = False
        self.wholes += 1
        self._take(self.replica.take_whole, message)

    def _take_change(self, message: object = None, *_: object) -> None:
        if not self._asked:  # else it follows a state that is not here
            self.changes += 1
            self._take(self.replica.take_change, message)

    def _take(self, take: Callable[[object], None], message: object) -> None:
        try:
            take(message)
        except InputError as error:
            self.rejected += 1
            LOG.info("a message of the model was not taken: %s", error)
            self._ask()
        else:
            self._on_model()

    def _take_state(self, data: bytes) -> None:
        if len(data) != STATE_DTYPE.itemsize:
            self.rejected += 1
            return
        self.states += 1
        self._on_state(np.frombuffer(data, STATE_DTYPE)[0])

    def _take_end(self, message: object = None, *_: object) -> None:
        outcome = message.get("outcome") if isinstance(message, Mapping) else None
        self._on_event(f"the shared session has ended: {peer_text(str(outcome))}")

    def _ask(self) -> None:
        """Ask for the whole model, once until it comes."""
        line = self._connection.line
        if line is not None and not self._asked:
            self._asked = True
            self._asking = asyncio.get_running_loop().create_task(self._emit(line.client))

    async def _emit(self, client: Any) -> None:
        try:
            await client.emit(AGAIN, None)
        except Exception as error:  # noqa: BLE001 - the library's own; the connection is restored
            LOG.info("the model could not be asked for: %s", error)
