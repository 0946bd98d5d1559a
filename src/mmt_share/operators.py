"""The operators at the server of a shared model: listeners that may ask for control."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Final

import socketio

from mmt.core.output.logs import REPEAT_PERIOD_S, RepeatLimit
from mmt.link.access import Access
from mmt_share.control_messages import ASK, MOTION, MOTION_HZ, RELEASE
from mmt_share.relay import ConnectedListener

_LONGEST_BYTES: Final = 4096
"""Longest message of motion that is accepted; one of a hundred records has 3704."""


class Operators:
    """Pass on the messages of operators, but the motion of at most one of them.

    Parameters
    ----------
    server
        The Socket.IO server.
    access
        Holds the token for control.
    tell
        Called with each message of an operator, as keywords: ``control`` ("ask", "release",
        "motion" or "gone"), ``who``, and ``name`` or ``data``.
    """

    def __init__(
        self,
        server: socketio.AsyncServer,
        access: Access,
        tell: Callable[..., None],
    ) -> None:
        self.access = access
        self.messages_hz = MOTION_HZ
        self._tell = tell
        self._joined: dict[str, ConnectedListener] = {}
        self._used: set[str] = set()
        self._asks = RepeatLimit()
        self._waiting: dict[str, asyncio.TimerHandle] = {}  # asked again within a second
        self._admitted: int | None = None
        self.refused = 0
        """Messages of motion that were not passed on."""
        server.on(ASK, self._on_ask)
        server.on(RELEASE, self._on_release)

    def distinct(self, name: str, number: int) -> str:
        """Return a name for an operator that no other operator has had."""
        while not name or name in self._used:
            name = f"{name or 'operator'} {number}"
        self._used.add(name)
        return name

    def join(self, sid: str, operator: ConnectedListener) -> dict[str, Callable[[bytes], None]]:
        """Add an operator; return the handlers of its frequent events."""
        self._joined[sid] = operator
        return {MOTION: partial(self._on_motion, operator.number)}

    def leave(self, sid: str) -> None:
        """Forget a closed connection; if it was an operator's, report that it is gone."""
        operator = self._joined.pop(sid, None)
        self._forget_ask(sid)
        if operator is not None:
            self._tell(control="gone", who=operator.number)

    def admit_motion(self, number: int | None) -> None:
        """Pass on only the motion of this operator; None passes on none."""
        self._admitted = number

    def send(self, number: int, message: bytes) -> None:
        """Send an operator a message, if it is still connected."""
        for operator in self._joined.values():
            if operator.number == number:
                operator.feed.queue_message(message)

    def _on_ask(self, sid: str, *_: object) -> None:
        operator = self._joined.get(sid)
        if operator is None or sid in self._waiting:
            return
        if self._asks.allow(sid):
            self._tell(control="ask", who=operator.number, name=operator.name)
        else:
            loop = asyncio.get_running_loop()
            self._waiting[sid] = loop.call_later(REPEAT_PERIOD_S, self._ask_late, sid)

    def _ask_late(self, sid: str) -> None:
        del self._waiting[sid]
        self._on_ask(sid)

    def _forget_ask(self, sid: str) -> None:
        if (waiting := self._waiting.pop(sid, None)) is not None:
            waiting.cancel()

    def _on_release(self, sid: str, *_: object) -> None:
        self._forget_ask(sid)
        if sid in self._joined:
            self._tell(control="release", who=self._joined[sid].number)

    def _on_motion(self, number: int, data: object) -> None:
        if number != self._admitted or not isinstance(data, bytes) or len(data) > _LONGEST_BYTES:
            self.refused += 1
        else:
            self._tell(control="motion", who=number, data=data.hex())
