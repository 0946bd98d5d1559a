"""Send orders to a running leader from another program, over its monitor's WebSocket."""

import asyncio
import json
from collections.abc import Mapping
from typing import Any, Final

import aiohttp

from mmt.core.errors import InputError, MmtError
from mmt.link.access import TOKEN_VARIABLE, Access, check_scheme
from mmt.link.connection import check_url, connection_advice
from mmt.web.page_server import REFUSED, header_of

_TIMEOUT_S: Final = 10.0
_NOT_FOUND: Final = 404


async def give_order(url: str, access: Access, order: Mapping[str, Any]) -> str:
    """Send a leader an order, as its monitor's page does, and return the answer's sentence.

    Parameters
    ----------
    url
        URL of the leader, ``http://HOST:PORT`` or ``https://HOST:PORT``.
    access
        Token and certificates of this side.
    order
        The order without its ``id``.

    Raises
    ------
    InputError
        The URL or the token is wrong, no leader with a monitor is there, or it refuses the order.
    MmtError
        No leader answers, or it has too many viewers.
    """
    check_url(url)
    check_scheme(url, access)
    connector = aiohttp.TCPConnector(ssl=access.client_context() or True)
    try:
        async with (
            asyncio.timeout(_TIMEOUT_S),
            aiohttp.ClientSession(connector=connector) as session,
            session.ws_connect(f"{url.rstrip('/')}/monitor/socket") as socket,
        ):
            await socket.send_str(json.dumps({"token": access.token}))
            await socket.send_str(json.dumps({"id": 1, **order}))
            answer = await _answer(socket)
            code = socket.close_code
    except (aiohttp.ClientError, OSError, TimeoutError, ValueError) as error:
        if isinstance(error, aiohttp.WSServerHandshakeError) and error.status == _NOT_FOUND:
            raise InputError(
                f"no leader with a monitor is at {url}: give the address of the leader, "
                "and start it with --monitor"
            ) from error
        reason = f"{type(error).__name__}: {error}".removesuffix(": ")
        advice = connection_advice(url, "command")
        raise MmtError(f"no answer of a leader at {url} ({reason}): check {advice}") from error
    if code == REFUSED:
        raise InputError(
            f"the token is missing or wrong: put the leader's token into {TOKEN_VARIABLE}"
        )
    if code == aiohttp.WSCloseCode.TRY_AGAIN_LATER:
        raise MmtError(f"the leader at {url} has too many viewers: close one of its pages")
    if answer is None:
        raise MmtError(f"the leader at {url} has ended without an answer")
    sentence = str(answer.get("text"))
    if answer.get("ok") is not True:
        raise InputError(sentence)
    return sentence


async def _answer(socket: aiohttp.ClientWebSocketResponse) -> dict[str, Any] | None:
    """Return the header of the first answer, or None if the socket is closed before."""
    async for message in socket:
        if message.type is aiohttp.WSMsgType.BINARY:
            header = header_of(message.data)
            if isinstance(header, dict) and header.get("kind") == "answer":
                return header
    return None
