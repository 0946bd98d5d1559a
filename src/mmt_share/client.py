"""Client of a shared model: keeps the connection, and an up-to-date copy of the model."""

import asyncio
import logging
import random
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.running.ending import start_task
from mmt.link.access import Access
from mmt.link.connection import LeaderConnection, check_url
from mmt.link.incoming import PeriodLimit, RateLimit
from mmt.link.protocol import peer_text
from mmt.link.websocket import Send
from mmt_share.changes import ModelReplica
from mmt_share.lag import FIRST_ANSWERS, ListenerState
from mmt_share.messages import (
    AGAIN,
    CHANGE,
    END,
    HAVE,
    HUBS,
    LONGEST_ADDRESS,
    LONGEST_MESSAGE,
    MODEL,
    MOST_HUBS,
    SHARING_VERSION,
    STATE,
    STATE_DTYPE,
    TOKEN_VARIABLE,
    WELCOME,
    Hello,
    ModelDescription,
)
from mmt_share.tables import Listening

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel
    from mmt_share.operator import OperatorClient

LOG: Final = logging.getLogger("mmt_share")

_MESSAGES_HZ: Final = 50.0
"""Rate limit of 500 messages and 1 MB a second: more than any leader sends."""
ANSWER_PERIOD_S: Final = 1.0
STATES_HZ: Final = 1.0
"""Rate of the states that are answered, from which the leader knows the lag."""


class ListenerClient:
    """Connect to a shared model, and keep a copy of it.

    Parameters
    ----------
    settings
        The scene's ``[listening]``.
    on_event
        Called with a sentence whenever something happens that a person wants to know.
    operator
        Asks for control over the same connection; None if the listener does not.
    on_message
        Called with the event and the argument of each accepted message: for `MODEL` and `CHANGE`
        when the copy is updated; for `STATE` with a record of `STATE_DTYPE` as bytes.
    states_hz
        Most states of the hand that are wanted in a second, or None for all.

    Raises
    ------
    InputError
        The URL is not valid, or the token or a certificate cannot be read.
    """

    def __init__(
        self,
        settings: Listening,
        *,
        on_event: Callable[[str], None] = lambda _: None,
        operator: "OperatorClient | None" = None,
        on_message: Callable[[str, Any], None] = lambda _, __: None,
        states_hz: float | None = STATES_HZ,
    ) -> None:
        self.replica = ModelReplica()
        self.session: dict[str, Any] = {}
        """Identifier and name of the leader's session; empty before its welcome."""
        self.wholes = self.changes = self.states = 0
        """Number of messages received, by kind."""
        self.rejected = 0
        self._refused = ""
        self._settings = settings
        self._operator = operator
        self._on_event, self._on_message = on_event, on_message
        self.hubs: list[str] = []
        """Addresses of other hubs, to connect to if this one is full or lost."""
        self._news = asyncio.Event()
        self._asked = False
        self._answers, self._answering = 0, PeriodLimit(ANSWER_PERIOD_S)
        self._emitting: set[asyncio.Task[None]] = set()
        self._connection = LeaderConnection(
            settings.url,
            {
                **Hello(settings.name or "", operator is not None, states_hz).as_auth(),
                **({} if operator is None else operator.auth),
            },
            Access.from_settings(settings, variable=TOKEN_VARIABLE, table="listening"),
            RateLimit(_MESSAGES_HZ, lambda _: None, lambda _: None),
            on_open=self._on_open,
            on_broken=self._on_broken,
            role="listener",
            tables="[sharing] there and [listening] here",
            service="mmt-leader with --share",
            longest_message=LONGEST_MESSAGE,
            alternatives=self._other_hubs,
            on_refused=self._take_refusal,
        )

    @property
    def connected(self) -> bool:
        """Whether the leader is connected."""
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
            MODEL: partial(self._take, MODEL),
            CHANGE: partial(self._take, CHANGE),
            HUBS: self._take_hubs,
            END: self._take_end,
            **({} if self._operator is None else self._operator.handlers),
        }
        await self._connection.open(handlers, {STATE: self._take_state}, self._settings.patience_s)
        if self._connection.url != self._settings.url:
            self._on_event(f"{self._settings.url} is full: connected to {self._connection.url}")

    async def next_state(self) -> "tuple[ModelDescription, TextureModel | None]":
        """Wait for a state of the model that is new since the last call, and build it in a thread.

        Return the newest state's description and its model, or None for the model if it is not
        ready. A state that cannot be built is reported and skipped.
        """
        while True:
            await self._news.wait()
            self._news.clear()
            about = self.replica.about
            if about is None:
                continue
            if not about.ready:
                return about, None
            try:
                return about, await asyncio.to_thread(self.replica.build)
            except InputError as error:
                self._on_event(f"the shared model cannot be rendered: {error}")

    async def close(self) -> None:
        """Close the connection."""
        await self._connection.close()
        if self._operator is not None:
            self._operator.close()

    def request_model(self) -> None:
        """Request the whole model, unless it is requested already."""
        if self._connection.line is not None and not self._asked:
            self._asked = True
            asking = self._emit(AGAIN, None)
            if asking is not None and self._operator is not None:
                asking.add_done_callback(self._operator.welcome)

    # --- received messages

    def _on_open(self, send: Send) -> None:
        self._asked = False
        self._answers = 0
        if self._operator is not None:
            self._operator.open(send)

    def _on_broken(self, reason: str) -> None:
        if self._operator is not None:
            self._operator.close()
        self._on_event(f"the leader's model is cut off ({reason}): the last state stays")

    def _welcome(self, message: object = None, *_: object) -> None:
        if not isinstance(message, Mapping) or message.get("sharing") != SHARING_VERSION:
            self._on_event("what answers shares no model of this version: nothing is taken from it")
            return
        self.session = {
            name: peer_text(str(message.get(name, ""))) for name in ("session_id", "name")
        }
        self._take_hubs(message.get(HUBS))
        self._on_event(f"listening to {self.session['name'] or 'a session'}")
        self._on_message(WELCOME, message)
        self._asked = False
        self.request_model()

    def _take(self, event: str, message: object = None, *_: object) -> None:
        """Take a whole model or a change; a change is of no use while the whole is requested."""
        if event == MODEL:
            self._asked = False
            self.wholes += 1
        elif self._asked:
            return
        else:
            self.changes += 1
        try:
            self.replica.take(event, message)
        except InputError as error:
            self.rejected += 1
            LOG.info("a message of the model was not taken: %s", error)
            if event == CHANGE:  # the whole model would come again as it is
                self.request_model()
            elif str(error) != self._refused:
                self._refused = str(error)
                self._on_event(f"the shared model cannot be taken: {error}")
        else:
            self._news.set()
            self._on_message(event, message)

    def _take_state(self, data: bytes) -> None:
        if len(data) != STATE_DTYPE.itemsize:
            self.rejected += 1
            return
        self.states += 1
        self._answer(float(np.frombuffer(data, STATE_DTYPE)["time_s"][0]), time.monotonic_ns())
        self._on_message(STATE, data)

    def _take_hubs(self, addresses: object = None, *_: object) -> None:
        given = addresses if isinstance(addresses, list) else []
        self.hubs = [url for url in given[:MOST_HUBS] if self._may_turn_to(url)]

    def _take_refusal(self, data: object) -> None:
        if isinstance(data, Mapping):  # a full hub names others
            self._take_hubs(data.get(HUBS))

    def _may_turn_to(self, url: object) -> bool:
        """Whether this is a valid address with the same scheme as the configured one."""
        if not isinstance(url, str) or len(url) > LONGEST_ADDRESS:
            return False
        try:
            check_url(url)
        except InputError:
            return False
        return url.partition(":")[0] == self._settings.url.partition(":")[0]

    def _other_hubs(self) -> list[str]:
        """Return the other hubs in random order, so that listeners do not all go to the same."""
        return random.sample(self.hubs, len(self.hubs))

    def _take_end(self, message: object = None, *_: object) -> None:
        outcome = message.get("outcome") if isinstance(message, Mapping) else None
        self._on_message(END, message)
        ended = f"the shared session has ended: {peer_text(str(outcome))}"
        self._on_event(f"{ended}: the last state stays")

    def _answer(self, time_s: float, now_ns: int) -> None:
        """Answer a state with `HAVE`: the first eight, then one a second."""
        if self._answers >= FIRST_ANSWERS and not self._answering.passes(1e-9 * now_ns):
            return
        self._answers += 1
        self._emit(HAVE, ListenerState(self.replica.number % 2**32, now_ns, time_s).pack())

    def _emit(self, event: str, argument: object) -> asyncio.Task[None] | None:
        line = self._connection.line
        if line is None:
            return None
        return start_task(_sent(line.client, event, argument), self._emitting)


async def _sent(client: Any, event: str, argument: object) -> None:
    try:
        await client.emit(event, argument)
    except Exception as error:  # noqa: BLE001 - the library's own; the connection is restored
        LOG.info("%s could not be sent: %s", event, error)
