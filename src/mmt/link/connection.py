"""The follower's connection: tried until the leader answers, and taken up after a break."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Final

import socketio

from mmt.core.errors import MmtError
from mmt.link.access import Access, check_scheme
from mmt.link.dialling import ATTEMPT_S, Line, check_url, distrust, what_to_check
from mmt.link.direct import Send, client_send
from mmt.link.gate import Gate
from mmt.link.log import LOG
from mmt.link.protocol import MAX_SENTENCE, loss_of, printable
from mmt.link.receiving import Handlers

_BETWEEN_ATTEMPTS_S: Final = 0.2


class Connection:
    """Connect to a leader, and stay connected.

    Parameters
    ----------
    url
        Of the leader.
    auth
        Sent with every connection, beside the token.
    access
        The token and the certificates of this side.
    gate
        Bounds what comes.
    on_open
        Called with what sends a message, whenever the link is up.
    on_broken
        Called with the reason in plain words, whenever it no longer is.

    Raises
    ------
    InputError
        `url` is none, or without TLS where there are certificates, or one of these cannot be
        used.
    """

    def __init__(
        self,
        url: str,
        auth: Mapping[str, object],
        access: Access,
        gate: Gate,
        *,
        on_open: Callable[[Send], None],
        on_broken: Callable[[str], None],
    ) -> None:
        check_url(url)
        check_scheme(url, access)
        self._tls = access.client_context()
        self._url = url
        self._auth = {**auth} if access.token is None else {**auth, "token": access.token}
        self._gate = gate
        self._on_open = on_open
        self._on_broken = on_broken
        self._refusal: str | None = None
        self.line: Line | None = None
        self.connected = False

    async def open(
        self, handlers: Mapping[str, Callable[..., None]], frequent: Handlers, timeout_s: float
    ) -> None:
        """Connect, waiting so long for a leader that is not there yet.

        Parameters
        ----------
        handlers
            By event.
        frequent
            Likewise, called past the library where they can be.
        timeout_s
            How long to wait.

        Raises
        ------
        MmtError
            No leader answered in time, or it refused; the message says why.
        """
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        while True:
            problem = await self._attempt(handlers, frequent, min(ATTEMPT_S, max(timeout_s, 0.1)))
            if problem is None:
                return
            if self._refusal is not None:
                raise MmtError(f"the leader at {self._url} refused: {self._refusal}")
            if distrust(problem):
                raise MmtError(
                    f"the leader at {self._url} and this follower do not trust each other "
                    f"({problem}): check certificate, key and authority of [link] on both"
                )
            if loop.time() + _BETWEEN_ATTEMPTS_S > deadline_s:
                raise MmtError(
                    f"no leader answered at {self._url} within {timeout_s:g} s ({problem}): "
                    f"start mmt-leader there, and check {what_to_check(self._url)}"
                )
            await asyncio.sleep(_BETWEEN_ATTEMPTS_S)

    async def ask(self, event: str, payload: object, timeout_s: float) -> object:
        """Send an event and return what the leader answers.

        Raises
        ------
        ConnectionError
            It did not answer in time, or there is no connection.
        """
        if self.line is None:
            raise ConnectionError
        try:
            return await self.line.client.call(event, payload, timeout=timeout_s)
        except socketio.exceptions.SocketIOError as error:
            raise ConnectionError from error

    async def close(self) -> None:
        """Close the connection for good; nothing happens where there is none."""
        line, self.line = self.line, None
        if line is not None:
            await line.close()
        self.connected = False

    async def _attempt(
        self,
        handlers: Mapping[str, Callable[..., None]],
        frequent: Handlers,
        timeout_s: float,
    ) -> str | None:
        """Try once to connect; return what stood in the way."""
        self._refusal = None
        own: dict[str, Callable[..., None]] = {
            "connect": self._on_connect,
            "connect_error": self._on_refused,
            "disconnect": self._on_disconnect,
        }
        self.line = line = Line.make({**handlers, **own}, frequent, self._gate, self._tls)
        try:
            return await line.open(self._url, self._auth, timeout_s)
        finally:
            if not self.connected:
                self.line = None
                await line.close()

    def _on_connect(self) -> None:
        self.connected = True
        if self.line is not None:
            self._on_open(client_send(self.line.client))

    def _on_refused(self, problem: object = None) -> None:
        if isinstance(problem, Mapping) and "message" in problem:
            self._refusal = printable(str(problem["message"]), MAX_SENTENCE)
            LOG.warning("refused by the leader: %s", self._refusal)

    def _on_disconnect(self, reason: str) -> None:
        self.connected = False
        if self.line is not None and reason == self.line.client.reason.TRANSPORT_ERROR:
            self.line.drop()
        self._on_broken(loss_of(reason))
