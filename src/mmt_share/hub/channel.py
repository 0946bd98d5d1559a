"""The channel at a Redis server by which hubs exchange messages."""

import asyncio
import logging
import uuid
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from typing import Any, Final

import msgpack
import redis.asyncio
from redis.asyncio.retry import Retry
from redis.backoff import NoBackoff
from redis.exceptions import AuthenticationError, NoPermissionError, RedisError

from mmt.core.errors import InputError, MmtError, without_secrets
from mmt.core.running.ending import cancel_until_ended

LOG: Final = logging.getLogger("mmt_share")

START_IT: Final = (
    "start one there (`apt install redis-server`, or `redis-server --port 6379`), "
    "and check --redis, or redis of [hub]"
)

REFUSED: Final = "the Redis server refuses the user or the password"
FORBIDDEN: Final = "the Redis server forbids this user the channel of the hubs"
DISTRUSTED: Final = "the Redis server's certificate is not trusted"

_MENDED_BY: Final = {
    REFUSED: "check redis of [hub], redis://USER:PASSWORD@HOST:PORT",
    FORBIDDEN: "allow it &mmt-hubs*, +publish, +subscribe and +unsubscribe (ACL SETUSER)",
    DISTRUSTED: "name the authority, rediss://HOST:PORT?ssl_ca_certs=FILE, and the host as the "
    "certificate does",
}

_ANSWER_S: Final = 1.0
"""Time-out of an answer of Redis, and of sending it a message."""
_NOTHING: Final = b""
"""A message that hubs ignore."""
_RETRY_S: Final = 0.5
_SILENCE_S: Final = 5.0
"""Time-out of reading from Redis, which returns to each hub at least its own beat once a second."""


class HubChannel:
    """Publish messages to the hubs of a group, and deliver theirs.

    Parameters
    ----------
    url
        URL of the Redis server.
    group
        Only hubs of the same group exchange messages.
    deliver
        Called with each event from a hub, this one included, and its argument.

    Raises
    ------
    InputError
        The URL is not valid.
    """

    def __init__(self, url: str, group: str, deliver: Callable[[str, Any], None]) -> None:
        self._channel, self._deliver = f"mmt-hubs {group}", deliver
        self._own_id = uuid.uuid4().hex
        try:
            self._redis = redis.asyncio.Redis.from_url(
                url,
                socket_timeout=_SILENCE_S,
                socket_connect_timeout=_ANSWER_S,
                retry=Retry(NoBackoff(), 0),
            )
        except ValueError:  # its message may quote a part of the password
            raise InputError(
                "--redis: this is no URL of Redis; allowed is redis://USER:PASSWORD@HOST:PORT, "
                "with the characters / ? # of a password as %2F %3F %23"
            ) from None
        self.reached = False
        """Whether Redis answered when it was last asked."""
        self._receiving: list[asyncio.Task[None]] = []

    def start(self) -> None:
        """Start to receive from the other hubs."""
        self._receiving = [asyncio.get_running_loop().create_task(self._receive())]

    async def check(self) -> str | None:
        """Publish an empty message on the hubs' channel; return None, or why that fails.

        Until Redis is `reached`, also check that the message is received.
        """
        try:
            async with asyncio.timeout(_ANSWER_S), AsyncExitStack() as stack:
                if not self.reached:
                    heard = await stack.enter_async_context(self._redis.pubsub())
                    await heard.subscribe(self._channel)
                await self._redis.publish(self._channel, _NOTHING)
                while not self.reached:
                    message = await heard.get_message(timeout=_ANSWER_S)
                    self.reached = message is not None and message["type"] == "message"
        except (RedisError, OSError, TimeoutError) as error:
            self.reached = False
            return _why(error)
        return None

    async def require(self) -> None:
        """Check that Redis can be used.

        Raises
        ------
        MmtError
            Redis cannot be used; the message says why.
        """
        problem = await self.check()
        if problem in _MENDED_BY:
            raise MmtError(f"{problem}: {_MENDED_BY[problem]}")
        if problem is not None:
            raise MmtError(f"no Redis server answers ({problem}): {START_IT}")

    async def publish(self, event: str, message: Any) -> None:
        """Send an event to every hub, or to this one alone while Redis is lost."""
        self._deliver(event, message)
        if self.reached:
            packed = msgpack.packb([self._own_id, event, message])
            with suppress(RedisError, OSError):  # the beats tell that it is missing
                async with asyncio.timeout(_ANSWER_S):
                    await self._redis.publish(self._channel, packed)

    async def close(self) -> None:
        """Close the connections to Redis."""
        await cancel_until_ended(self._receiving)
        with suppress(RedisError, OSError):
            await self._redis.aclose()

    async def _receive(self) -> None:
        """Deliver what other hubs publish; subscribe again whenever Redis was lost."""
        while True:
            with suppress(RedisError, OSError):
                async with self._redis.pubsub(ignore_subscribe_messages=True) as subscribed:
                    await subscribed.subscribe(self._channel)
                    async for message in subscribed.listen():
                        self._take(message["data"])
            await asyncio.sleep(_RETRY_S)

    def _take(self, packed: bytes) -> None:
        """Deliver a message, which is not trusted, unless it is this hub's own."""
        try:
            sender, event, message = msgpack.unpackb(packed)
        except (ValueError, TypeError, RecursionError):
            return
        if sender != self._own_id:
            try:
                self._deliver(event, message)
            except Exception:
                LOG.exception("a message of another hub could not be used")


def _why(error: Exception) -> str:
    """Return in a sentence why Redis cannot be used."""
    text = str(error)
    if isinstance(error, AuthenticationError) or text.startswith(("NOAUTH", "WRONGPASS")):
        return REFUSED
    if isinstance(error, NoPermissionError):
        return FORBIDDEN
    if "CERTIFICATE_VERIFY_FAILED" in text:
        return DISTRUSTED
    return without_secrets(text).rstrip(".") or "no answer"
