"""A hub's copy of the shared model, from the messages that the feeder passes on."""

import struct
import time
from collections.abc import Mapping
from typing import Any, Final

from mmt.core.errors import InputError
from mmt.link.incoming import PeriodLimit
from mmt.link.protocol import encode_event
from mmt_share.changes import ModelReplica
from mmt_share.messages import CHANGE, END, MODEL, STATE, STATE_DTYPE, WELCOME
from mmt_share.relay import Relay

_TIME_S: Final = struct.Struct("<d")
"""Session time, with which a state of the hand begins."""


class HubCopy:
    """Take a leader's messages, repeated or out of order, and offer listeners the new ones.

    Repeated models and changes are ignored, so that two hubs may feed at once. If one is missing,
    `lacking` is True until the whole model has come.

    Parameters
    ----------
    relay
        Relay of the hub's server.
    states_hz
        Most states of the hand that listeners get in a second.

    Attributes
    ----------
    welcome
        Identifier, name and rate of the leader's session, empty before the first.
    replica
        The newest state of the model.
    lacking
        Whether the session, or a state of the model, is missing.
    """

    def __init__(self, relay: Relay, states_hz: float) -> None:
        self._relay = relay
        self._states = PeriodLimit(1.0 / states_hz)
        self.replica = ModelReplica()
        self.welcome: dict[str, Any] = {}
        self.lacking = True

    @property
    def session_id(self) -> str:
        """Identifier of the leader's session, empty before the first."""
        return str(self.welcome.get("session_id", ""))

    @property
    def number(self) -> int:
        """Number of the model, 0 before the first of the session."""
        return self.replica.number

    def receive(self, event: str, message: Any) -> None:
        """Take a message that the feeder passes on."""
        if event == STATE:
            whole = isinstance(message, bytes) and len(message) == STATE_DTYPE.itemsize
            if whole and self._states.passes(time.monotonic()):
                (time_s,) = _TIME_S.unpack_from(message)
                self._relay.offer_state(encode_event(STATE, message), time_s, time.monotonic_ns())
        elif not isinstance(message, Mapping):
            return
        elif event == WELCOME:
            self._take_session(message)
        elif event in {MODEL, CHANGE}:
            self._take_model(event, message)
        elif event == END:
            self._relay.finish(str(message.get("outcome")))

    def _take_session(self, message: Mapping[str, Any]) -> None:
        same = self.session_id == message.get("session_id")
        self.welcome = {name: message.get(name) for name in ("session_id", "name", "rate_hz")}
        if same:
            return
        self.replica = ModelReplica()
        self._relay.begin()
        self.lacking = False

    def _take_model(self, event: str, message: Mapping[str, Any]) -> None:
        number = message.get("number")
        if message.get("session_id") != self.session_id:
            self.lacking = True
            return
        if isinstance(number, int) and number <= self.number:
            self.lacking &= event != MODEL
            return
        replica = self.replica
        try:
            replica.take(event, message)
        except InputError:
            self.lacking = True
            return
        self.lacking = False
        encoded = encode_event(event, message)
        if event == MODEL:
            self._relay.offer_model(replica.number, encoded, None)
        else:
            self._relay.offer_model(
                replica.number, lambda: encode_event(MODEL, replica.message()), encoded
            )
