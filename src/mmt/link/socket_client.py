"""A Socket.IO client that is opened and closed once, in bounded time."""

import asyncio
import logging
import ssl
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import aiohttp
import socketio

from mmt.core.running.ending import start_task
from mmt.link.incoming import RateLimit
from mmt.link.protocol import MAX_MESSAGE_BYTES, MAX_SENTENCE, peer_text
from mmt.link.websocket import Handlers, Packet, client_websocket, wire_logger

LOG: Final = logging.getLogger("mmt.link")

ATTEMPT_S: Final = 3.0
"""How long one attempt to connect may take."""
CLOSE_TIMEOUT_S: Final = 2.0
"""How long sending the queue may take before the connection is dropped."""
ACKNOWLEDGE_S: Final = 0.4
"""How long the leader may take to acknowledge the end of a session, and then the closing of the
link: with a leader that hangs, stopping the follower takes less than a second."""


@dataclass(frozen=True)
class SocketClient:
    """A Socket.IO client with the HTTP session that it uses."""

    client: socketio.AsyncClient
    session: aiohttp.ClientSession
    _dropping: set[asyncio.Task[bool]] = field(default_factory=set)

    @classmethod
    def make(
        cls,
        handlers: Mapping[str, Callable[..., None]],
        direct: Handlers,
        rate_limit: RateLimit,
        tls: ssl.SSLContext | None = None,
        longest_message: int = MAX_MESSAGE_BYTES,
    ) -> "SocketClient":
        """Return a client that is not connected, with a handler for each event.

        `direct` handlers bypass the library if possible; `rate_limit` limits the rate of all
        messages. Without `tls` an https URL is verified by the system's authorities.
        """
        tracing = aiohttp.TraceConfig()
        tracing.on_request_redirect.append(_refuse_redirect)
        session = aiohttp.ClientSession(
            trace_configs=[tracing],
            connector=aiohttp.TCPConnector(ssl=tls or True),
            timeout=aiohttp.ClientTimeout(total=ATTEMPT_S, sock_connect=ATTEMPT_S),
            ws_response_class=client_websocket(direct, rate_limit),
        )
        client = socketio.AsyncClient(
            serializer=Packet,
            handle_sigint=False,
            http_session=session,
            request_timeout=CLOSE_TIMEOUT_S,
            reconnection=False,
            websocket_extra_options={"max_msg_size": longest_message},
            logger=wire_logger(),
            engineio_logger=wire_logger(),
        )
        for event, handler in {**handlers, **direct}.items():
            client.on(event, handler)
        return cls(client, session)

    async def open(self, url: str, auth: Mapping[str, object], timeout_s: float) -> str | None:
        """Connect; return None, or the problem as a sentence."""
        try:
            async with asyncio.timeout(timeout_s):
                await self.client.connect(
                    url, auth=dict(auth), transports=["websocket"], wait_timeout=timeout_s
                )
        except (socketio.exceptions.ConnectionError, TimeoutError) as error:
            return _first_cause(error)
        except Exception as error:  # noqa: BLE001 - the library's, if another server answers
            return f"no leader's answer: {type(error).__name__}"
        return None

    def drop(self) -> None:
        """Close the WebSocket of a link that timed out, which the library leaves open."""
        websocket = getattr(self.client.eio, "ws", None)
        if isinstance(websocket, aiohttp.ClientWebSocketResponse) and not websocket.closed:
            start_task(websocket.close(), self._dropping)

    async def close(self) -> None:
        """Close the client and its HTTP session, in bounded time."""
        try:
            async with asyncio.timeout(ACKNOWLEDGE_S):
                await self.client.disconnect()
        except TimeoutError:
            LOG.info("the leader did not answer the closing of the link")
        finally:
            for task in self._dropping:
                task.cancel()
            await asyncio.gather(*self._dropping, return_exceptions=True)
            await self.session.close()


async def _refuse_redirect(*_: object) -> None:
    """Refuse a redirect, so that only the server that the user named gets the token.

    Raises
    ------
    aiohttp.ClientConnectionError
        Always.
    """
    raise aiohttp.ClientConnectionError("it redirects to another address, which is not followed")


def _first_cause(error: BaseException) -> str:
    """Return the message of the error at the root of the chain."""
    cause: BaseException | None = error
    while cause is not None:
        error, cause = cause, cause.__cause__ or cause.__context__
    if isinstance(error, TimeoutError | asyncio.CancelledError):  # their texts name a class
        return "nothing came back in time"
    return peer_text(str(error), MAX_SENTENCE) or type(error).__name__
