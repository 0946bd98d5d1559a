"""A listener's side: connected to whoever shares a model, with a copy that is kept up to date."""

import asyncio
import logging
import random
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.link.access import Access
from mmt.link.connection import LeaderConnection, check_url
from mmt.link.protocol import peer_text
from mmt.link.rate_limit import PeriodLimit, RateLimit
from mmt.link.websocket import Send
from mmt_share.lag import FIRST_ANSWERS, Have
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
    About,
    Hello,
)
from mmt_share.replica import ModelReplica
from mmt_share.tables import Listening

if TYPE_CHECKING:
    from mmt.texture.model.texture_model import TextureModel
    from mmt_share.operator import OperatorClient

LOG: Final = logging.getLogger("mmt_share")

_MESSAGES_HZ: Final = 50.0
"""500 messages a second may come, and 1 MB: more than any leader sends."""
ANSWER_PERIOD_S: Final = 1.0
STATES_HZ: Final = 1.0
"""As many states of the hand as are answered, by which the leader knows how far behind this is."""


class ListenerClient:
    """Connect to a shared model, and keep a copy of it.

    Parameters
    ----------
    settings
        The scene's ``[listening]``.
    on_event
        Called with a sentence whenever something happens that a person wants to know.
    operator
        Asks for control over the same connection; None for a listener that does not.
    on_message
        Called with the event and the argument of each message that was taken: after `MODEL` or
        `CHANGE` the copy has changed, `STATE` is a record of `STATE_DTYPE` as bytes.
    states_hz
        How many states of the hand are wanted in a second at most, None for all, which a picture
        needs.

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
        """What the leader said of its session."""
        self.wholes = self.changes = self.states = 0
        """Messages taken."""
        self.rejected = 0
        self._settings = settings
        self._operator = operator
        self._on_event, self._on_message = on_event, on_message
        self.hubs: list[str] = []
        """Others to turn to if this one is full."""
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
            Access.of(settings, variable=TOKEN_VARIABLE, table="listening"),
            RateLimit(_MESSAGES_HZ, lambda _: None, lambda _: None),
            on_open=self._on_open,
            on_broken=self._on_broken,
            role="listener",
            tables="[sharing] there and [listening] here",
            longest_message=LONGEST_MESSAGE,
            alternatives=self._other_hubs,
            on_refused=self._take_refusal,
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
            HUBS: self._take_hubs,
            END: self._take_end,
            **({} if self._operator is None else self._operator.handlers),
        }
        await self._connection.open(handlers, {STATE: self._take_state}, self._settings.patience_s)
        if self._connection.url != self._settings.url:
            self._on_event(f"{self._settings.url} is full: connected to {self._connection.url}")

    async def next_state(self) -> "tuple[About, TextureModel | None]":
        """Wait for a state that is new since the last call; its model is built in a thread.

        Return what is said of it, and the model, None if it is not ready. Of several the newest is
        returned. One that cannot be built is told and passed over.
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
        """Leave."""
        await self._connection.close()
        if self._operator is not None:
            self._operator.close()

    def ask(self) -> None:
        """Ask for the whole model, once until it comes."""
        if self._connection.line is not None and not self._asked:
            self._asked = True
            asking = self._emit(AGAIN, None)
            if asking is not None and self._operator is not None:
                asking.add_done_callback(self._operator.welcome)

    # --- what comes

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
        self.ask()

    def _take_whole(self, message: object = None, *_: object) -> None:
        self._asked = False
        self.wholes += 1
        self._take(self.replica.take_whole, MODEL, message)

    def _take_change(self, message: object = None, *_: object) -> None:
        if not self._asked:  # else it follows a state that is not here
            self.changes += 1
            self._take(self.replica.take_change, CHANGE, message)

    def _take(self, take: Callable[[object], None], event: str, message: object) -> None:
        try:
            take(message)
        except InputError as error:
            self.rejected += 1
            LOG.info("a message of the model was not taken: %s", error)
            self.ask()
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
        if isinstance(data, Mapping):  # of a hub that has its most
            self._take_hubs(data.get(HUBS))

    def _may_turn_to(self, url: object) -> bool:
        """Whether this is the address of a hub, as safe as that which was given."""
        if not isinstance(url, str) or len(url) > LONGEST_ADDRESS:
            return False
        try:
            check_url(url)
        except InputError:
            return False
        return url.partition(":")[0] == self._settings.url.partition(":")[0]

    def _other_hubs(self) -> list[str]:
        """Return where else the model is to be had, in any order, so that not all go to one."""
        return random.sample(self.hubs, len(self.hubs))

    def _take_end(self, message: object = None, *_: object) -> None:
        outcome = message.get("outcome") if isinstance(message, Mapping) else None
        self._on_message(END, message)
        ended = f"the shared session has ended: {peer_text(str(outcome))}"
        self._on_event(f"{ended}: the last state stays")

    def _answer(self, time_s: float, now_ns: int) -> None:
        """Say what is here, at a low rate."""
        if self._answers >= FIRST_ANSWERS and not self._answering.passes(1e-9 * now_ns):
            return
        self._answers += 1
        self._emit(HAVE, Have(self.replica.number % 2**32, now_ns, time_s).pack())

    def _emit(self, event: str, argument: object) -> asyncio.Task[None] | None:
        line = self._connection.line
        if line is None:
            return None
        task = asyncio.get_running_loop().create_task(_sent(line.client, event, argument))
        self._emitting.add(task)
        task.add_done_callback(self._emitting.discard)
        return task


async def _sent(client: Any, event: str, argument: object) -> None:
    try:
        await client.emit(event, argument)
    except Exception as error:  # noqa: BLE001 - the library's own; the connection is restored
        LOG.info("%s could not be sent: %s", event, error)
