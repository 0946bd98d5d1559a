"""A Socket.IO connection to a leader: retried until the leader answers, and after a break.

The library's own reconnection ends for good after the first attempt with an unexpected failure,
such as a timeout while the leader is blocked. So this module makes each attempt.
"""

import asyncio
import logging
import urllib.parse
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import socketio

from mmt.core.errors import InputError, MmtError
from mmt.link.access import Access, check_scheme
from mmt.link.incoming import RateLimit
from mmt.link.protocol import MAX_MESSAGE_BYTES, MAX_SENTENCE, loss_of, peer_text
from mmt.link.socket_client import ATTEMPT_S, SocketClient
from mmt.link.websocket import Handlers, Send, client_send

LOG: Final = logging.getLogger("mmt.link")

_FIRST_RETRY_S: Final = 0.2
_LONGEST_RETRY_S: Final = 1.0
"""Delay before the second attempt, doubled after each one up to the longest."""


def check_url(url: str) -> None:
    """Raise InputError unless this is the URL of a leader."""
    try:
        parts = urllib.parse.urlsplit(url)
        good = parts.scheme in {"http", "https", "ws", "wss"} and bool(parts.hostname)
        good = good and (parts.port is None or parts.port > 0)
        good = good and parts.path in {"", "/"}  # the library would leave it out without a word
    except ValueError:
        good = False
    if not good:
        raise InputError(f"leader's URL {url!r}: allowed is http://HOST:PORT or https://HOST:PORT")


def connection_advice(url: str, role: str) -> str:
    """Return what the user should check; a client that TLS refuses gets no answer at all."""
    if url.startswith(("https:", "wss:")):
        return f"this {role}'s certificate, host, port and firewall"
    return "http or https, host, port and firewall"


class LeaderConnection:
    """Connect to a leader and stay connected.

    Parameters
    ----------
    url
        URL of the leader.
    auth
        Sent with every connection, beside the token.
    access
        The token and the certificates of this side.
    rate_limit
        Limits the rate of received messages.
    on_open
        Called with the function that sends a message, whenever the link is up.
    on_broken
        Called with the reason in plain words, whenever the link breaks.
    role, tables, service
        For errors: the role of this side, the tables of its keys, and what it connects to.
    longest_message
        Longest message (bytes); a longer one closes the connection.
    alternatives
        Returns further URLs of the same service, tried in turn after a break and after a
        refusal.
    on_refused
        Called with the data of a refusal, without its message.

    Raises
    ------
    InputError
        `url` is not valid, or lacks TLS although there are certificates, or one of these cannot
        be used.
    """

    def __init__(
        self,
        url: str,
        auth: Mapping[str, object],
        access: Access,
        rate_limit: RateLimit,
        *,
        on_open: Callable[[Send], None],
        on_broken: Callable[[str], None],
        role: str = "follower",
        tables: str = "[link] on both",
        service: str = "mmt-leader",
        longest_message: int = MAX_MESSAGE_BYTES,
        alternatives: Callable[[], Sequence[str]] = tuple,
        on_refused: Callable[[object], None] = lambda _: None,
    ) -> None:
        check_url(url)
        check_scheme(url, access)
        self._tls = access.client_context()
        self._url = url
        self._auth = {**auth} if access.token is None else {**auth, "token": access.token}
        self._rate_limit = rate_limit
        self._on_open = on_open
        self._on_broken = on_broken
        self._role, self._tables, self._service = role, tables, service
        self._longest_message = longest_message
        self._alternatives = alternatives
        self._take_refusal = on_refused
        self.url = url
        """URL of the newest connection."""
        self._refusal: str | None = None
        self._handlers: dict[str, Callable[..., None]] = {}
        self._frequent: Handlers = {}
        self._restoring: asyncio.Task[None] | None = None
        self._attempting = False
        self.line: SocketClient | None = None
        self.connected = False

    async def open(
        self, handlers: Mapping[str, Callable[..., None]], frequent: Handlers, timeout_s: float
    ) -> None:
        """Connect, waiting up to `timeout_s` for the leader to appear.

        Parameters
        ----------
        handlers
            Handlers by event.
        frequent
            Handlers of frequent events, which bypass the library if possible.
        timeout_s
            How long to wait.

        Raises
        ------
        MmtError
            No leader answered in time, or it refused; the message says why.
        """
        self._handlers, self._frequent = dict(handlers), frequent
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + timeout_s
        for pause_s in _pauses_s():
            problem = await self._attempt(self._url, min(ATTEMPT_S, max(timeout_s, 0.1)))
            if problem is None:
                return
            if (refusal := self._refusal) is not None:
                if await self._elsewhere({self._url}):
                    return
                raise MmtError(f"the leader at {self._url} refused: {refusal}")
            if "CERTIFICATE" in problem.upper():  # trying again is useless
                raise MmtError(
                    f"the leader at {self._url} and this {self._role} do not trust each other "
                    f"({problem}): check certificate, key and authority of {self._tables}"
                )
            left_s = deadline_s - loop.time()
            if left_s <= 0.0:
                advice = connection_advice(self._url, self._role)
                raise MmtError(
                    f"no leader answered at {self._url} within {timeout_s:g} s ({problem}): "
                    f"start {self._service} there, wait until it says ready, and check {advice}"
                )
            await asyncio.sleep(min(pause_s, left_s))

    async def request(self, event: str, payload: object, timeout_s: float) -> object:
        """Send an event and return the leader's acknowledgement.

        Raises
        ------
        ConnectionError
            The leader did not answer in time, or there is no connection.
        """
        if self.line is None:
            raise ConnectionError
        try:
            return await self.line.client.call(event, payload, timeout=timeout_s)
        except socketio.exceptions.SocketIOError as error:
            raise ConnectionError from error

    async def close(self) -> None:
        """Close the connection for good; without one, do nothing."""
        restoring, self._restoring = self._restoring, None
        if restoring is not None:
            restoring.cancel()
            await asyncio.gather(restoring, return_exceptions=True)
        line, self.line = self.line, None
        if line is not None:
            await line.close()
        self.connected = False

    async def _attempt(self, url: str, timeout_s: float) -> str | None:
        """Try once to connect; return None, or the problem."""
        self._refusal = None
        own: dict[str, Callable[..., None]] = {
            "connect": self._on_connect,
            "connect_error": self._on_refused,
            "disconnect": self._on_disconnect,
        }
        self.line = line = SocketClient.make(
            {**self._handlers, **own},
            self._frequent,
            self._rate_limit,
            self._tls,
            self._longest_message,
        )
        self._attempting = True
        try:
            problem = await line.open(url, self._auth, timeout_s)
        finally:
            self._attempting = False
            if not self.connected:
                self.line = None
                await line.close()
        if self.connected:  # perhaps although the last step timed out
            self.url = url
            return None
        return problem or "the connection was closed"

    async def _restore(self, broken: SocketClient) -> None:
        """Connect again after a break, for as long as it takes."""
        await broken.close()
        for pause_s in _pauses_s():
            await asyncio.sleep(pause_s)
            if await self._elsewhere(set(), self.url, self._url):
                return

    async def _elsewhere(self, tried: set[str], *first: str) -> bool:
        """Try each known URL, and those that refusals name, once; return whether one works."""
        for _ in range(2):  # not until none is new: a hostile server names new ones for ever
            for url in (*first, *self._alternatives()):
                if url not in tried:
                    tried.add(url)
                    if await self._attempt(url, ATTEMPT_S) is None:
                        return True
                    if self._refusal is not None:
                        LOG.warning("refused by %s: %s", url, self._refusal)
        return False

    def _on_connect(self) -> None:
        if self.line is not None:
            self.connected = True
            self._on_open(client_send(self.line.client))

    def _on_refused(self, problem: object = None) -> None:
        if isinstance(problem, Mapping) and "message" in problem:
            self._refusal = peer_text(str(problem["message"]), MAX_SENTENCE)
            self._take_refusal(problem.get("data"))

    def _on_disconnect(self, reason: str) -> None:
        line, self.line = self.line, None
        if line is None or not self.connected:
            return  # closed by this side, or never open
        self.connected = False
        if reason == line.client.reason.TRANSPORT_ERROR:
            line.drop()
        if not self._attempting:  # else the attempt fails, and is repeated
            self._restoring = asyncio.get_running_loop().create_task(self._restore(line))
        self._on_broken(loss_of(reason))


def _pauses_s() -> Iterator[float]:
    """Yield the delay (s) after each attempt."""
    pause_s = _FIRST_RETRY_S
    while True:
        yield pause_s
        pause_s = min(2.0 * pause_s, _LONGEST_RETRY_S)
