"""Make, open and close the follower's Socket.IO connection."""

import asyncio
import ssl
import urllib.parse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import aiohttp
import socketio

from mmt.core.errors import InputError
from mmt.link.gate import Gate
from mmt.link.log import LOG, wire_logger
from mmt.link.protocol import MAX_MESSAGE_BYTES
from mmt.link.receiving import Handlers, client_websocket

ATTEMPT_S: Final = 3.0
"""How long one attempt to connect may take."""
CLOSE_TIMEOUT_S: Final = 2.0
"""How long it may take to send what waits before the connection is dropped."""
ACKNOWLEDGE_S: Final = 0.4
"""How long the leader may take to answer the end of a session, and then the closing of the
link: with a leader that hangs, a person who ends the follower waits less than a second."""
_FIRST_RETRY_S: Final = 0.25
_LONGEST_RETRY_S: Final = 2.0
"""A link that broke is tried again after so long, twice as long each time up to the longest."""


@dataclass(frozen=True)
class Line:
    """A Socket.IO client, and the HTTP session that it uses."""

    client: socketio.AsyncClient
    session: aiohttp.ClientSession
    _dropping: set[asyncio.Task[bool]] = field(default_factory=set)

    @classmethod
    def make(
        cls,
        handlers: Mapping[str, Callable[..., None]],
        direct: Handlers,
        gate: Gate,
        tls: ssl.SSLContext | None = None,
    ) -> "Line":
        """Make one that is not connected, with a handler for each event.

        The `direct` ones are called past the library where they can be; the `gate` bounds
        all. Without `tls` an https URL is trusted as the system does.
        """
        session = aiohttp.ClientSession(
            connector=aiohttp.TCPConnector(ssl=tls or True),
            timeout=aiohttp.ClientTimeout(total=ATTEMPT_S, sock_connect=ATTEMPT_S),
            ws_response_class=client_websocket(direct, gate),
        )
        client = socketio.AsyncClient(
            serializer="msgpack",
            handle_sigint=False,
            http_session=session,
            request_timeout=CLOSE_TIMEOUT_S,
            reconnection_delay=_FIRST_RETRY_S,
            reconnection_delay_max=_LONGEST_RETRY_S,
            randomization_factor=_FIRST_RETRY_S / 2,
            websocket_extra_options={"max_msg_size": MAX_MESSAGE_BYTES},
            logger=wire_logger(),
            engineio_logger=wire_logger(),
        )
        for event, handler in {**handlers, **direct}.items():
            client.on(event, handler)
        return cls(client, session)

    async def open(self, url: str, auth: Mapping[str, object], timeout_s: float) -> str | None:
        """Connect; return None, or what stood in the way.

        A connection that breaks later is taken up again with the same `auth`.
        """
        try:
            async with asyncio.timeout(timeout_s):
                await self.client.connect(
                    url, auth=dict(auth), transports=["websocket"], wait_timeout=timeout_s
                )
        except (socketio.exceptions.ConnectionError, TimeoutError) as error:
            return _first_cause(error)
        return None

    def drop(self) -> None:
        """Close the WebSocket of a link that fell silent, which the library leaves open."""
        websocket = getattr(self.client.eio, "ws", None)
        if isinstance(websocket, aiohttp.ClientWebSocketResponse) and not websocket.closed:
            task = asyncio.get_running_loop().create_task(websocket.close())
            self._dropping.add(task)
            task.add_done_callback(self._dropping.discard)

    async def close(self) -> None:
        """Close whatever is open, and take up nothing again; in bounded time."""
        try:
            async with asyncio.timeout(ACKNOWLEDGE_S):
                await asyncio.sleep(0)  # a reconnection that was only just begun cannot be ended
                await self.client.shutdown()
                await self.client.disconnect()
        except TimeoutError:
            LOG.info("the leader did not answer the closing of the link")
        finally:
            for task in self._dropping:
                task.cancel()
            await asyncio.gather(*self._dropping, return_exceptions=True)
            await self.session.close()


def check_url(url: str) -> None:
    """Raise InputError unless this is the URL of a leader."""
    try:
        parts = urllib.parse.urlsplit(url)
        good = parts.scheme in {"http", "https", "ws", "wss"} and bool(parts.hostname)
        good = good and (parts.port is None or parts.port > 0)
    except ValueError:
        good = False
    if not good:
        raise InputError(f"leader's URL {url!r}: allowed is http://HOST:PORT or https://HOST:PORT")


def distrust(problem: str) -> bool:
    """Whether what stood in the way is a certificate, which does not change by trying again."""
    return "CERTIFICATE" in problem.upper()


def what_to_check(url: str) -> str:
    """Return what keeps a follower from its leader; one that TLS refuses just hears nothing."""
    if url.startswith(("https:", "wss:")):
        return "this follower's certificate, host, port and firewall"
    return "http or https, host, port and firewall"


def _first_cause(error: BaseException) -> str:
    """Return the sentence of the error that all others came from."""
    cause: BaseException | None = error
    while cause is not None:
        error, cause = cause, cause.__cause__ or cause.__context__
    return str(error) or type(error).__name__
