"""Client of an operator: a listener that asks for control of the leader's robot."""

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from mmt.core.arrays import Vector
from mmt.core.errors import InputError
from mmt.link.access import Access
from mmt.link.protocol import encode_event
from mmt.link.queue import SendQueue
from mmt.link.websocket import Send
from mmt_share.control_messages import (
    ASK,
    CONTACT,
    CONTROL,
    MOTION_DTYPE,
    RELEASE,
    ControlNews,
    SharedContact,
    encode_motion,
)

_GATHERED: Final = 10
"""Records in a message: at 1 kHz this gives a hundred messages a second, of 10 ms each."""
_WAITING: Final = 5
"""Most messages that are queued while the network stalls; older motion is of no use."""


class OperatorClient:
    """Ask for control over a listener's connection, and send the hand's motion while it has it.

    Parameters
    ----------
    access
        Holds the token for control.
    on_event
        Called with a sentence whenever something happens that a person wants to know.
    """

    def __init__(self, access: Access, on_event: Callable[[str], None]) -> None:
        self.auth: dict[str, Any] = {"control_token": access.token}
        """Entries of the connection's ``auth`` that other listeners do not send."""
        self.news: ControlNews | None = None
        """Newest message about control; None before the first and without a connection."""
        self.contact: SharedContact | None = None
        """Contact from which this hand's force is rendered, or None if it is not known."""
        self.contacts = self.records = self.rejected = 0
        """Contact messages received, motion records sent, malformed messages received."""
        self._on_event = on_event
        self._queue = SendQueue(_WAITING)
        self._gathered = np.zeros(_GATHERED, MOTION_DTYPE)
        self._count = 0
        self.wants = True
        """Whether this hand asks for control or has it; False after a refusal or the end."""

    @property
    def handlers(self) -> Mapping[str, Callable[..., None]]:
        """Handlers of the leader's messages to an operator, by event."""
        return {CONTROL: self._take_news, CONTACT: self._take_contact}

    @property
    def operates(self) -> bool:
        """Whether this hand has control."""
        return self.news is not None and self.news.state == "given"

    def open(self, send: Send) -> None:
        """Use this function to send from now on."""
        self._queue.open(send)

    def close(self) -> None:
        """Note that the connection is lost, and control with it."""
        self.news = self.contact = None
        self._queue.close()

    def welcome(self, _: object = None) -> None:
        """Ask for control if wanted and not asked yet on this connection."""
        if self.wants and self.news is None:
            self.request_control()

    def request_control(self) -> None:
        """Ask for control."""
        self.wants = True
        self._queue.put(0, encode_event(ASK, None))

    def release(self) -> None:
        """Withdraw the request, or give control back."""
        self.wants = False
        self.news = self.contact = None
        self._queue.put(0, encode_event(RELEASE, None))

    def put(
        self,
        time_ns: int,
        position_mm: Vector,
        velocity_mm_s: Vector,
        force_n: float,
        *,
        contact: bool,
    ) -> None:
        """Send the robot's wanted position for a time of this clock, in messages of ten records."""
        if self.news is None or not self.operates:
            return
        self._gathered[self._count] = (time_ns, position_mm, velocity_mm_s, force_n, contact)
        self._count += 1
        if self._count == _GATHERED:
            self._count = 0
            self._queue.put(_GATHERED, encode_motion(self.news.grant, self._gathered))
            self.records += _GATHERED

    def _take_news(self, message: object = None, *_: object) -> None:
        try:
            news = ControlNews.from_message(message)
        except InputError:
            self.rejected += 1
            return
        if news.state == "given" and not self.wants:
            return
        self.news, self._count = news, 0
        if news.state != "given":
            self.contact = None
            self.wants = news.state == "asked"
        self._on_event(_SENTENCES[news.state].format(why=f": {news.why}" if news.why else ""))

    def _take_contact(self, message: object = None, *_: object) -> None:
        try:
            contact = SharedContact.from_message(message)
        except InputError:
            self.rejected += 1
            return
        if self.operates:
            self.contact = contact
            self.contacts += 1


_SENTENCES: Final = {
    "asked": "asked the leader for control",
    "refused": "the leader refuses control{why}",
    "given": "control is here: this hand moves the robot",
    "ended": "control is over{why}",
}
