"""Client manager of python-socketio over Redis, by which hubs exchange messages."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from typing import Any, Final

import redis.asyncio
import socketio
from redis.asyncio.retry import Retry
from redis.backoff import ConstantBackoff, NoBackoff
from redis.exceptions import AuthenticationError, NoPermissionError, RedisError

from mmt.core.ending import cancel_until_ended
from mmt.core.errors import InputError, MmtError, without_secrets

HUBS_NAMESPACE: Final = "/hubs"
"""Namespace of the messages between hubs; no listener can connect to it."""

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
_NOTHING: Final = "null"
"""A message that python-socketio ignores."""
_RETRY_S: Final = 0.5
_SILENCE_S: Final = 5.0
"""Time-out of reading from Redis, which returns to each hub at least its own beat once a second."""


class _LocalDelivery(socketio.AsyncManager):  # type: ignore[misc] # the library has no types
    """Base class by which the manager over Redis delivers an event to this process.

    Events between hubs go straight to the hub, which keeps only the newest messages. The library
    would send them to listeners through queues that grow if a listener stalls.
    """

    deliver: Callable[[str, Any], None]

    async def emit(self, event: str, data: Any, namespace: str, *args: Any, **options: Any) -> None:
        if namespace == HUBS_NAMESPACE:
            self.deliver(event, data)
        else:
            await super().emit(event, data, namespace, *args, **options)


class HubManager(socketio.AsyncRedisManager, _LocalDelivery):  # type: ignore[misc]
    """The client manager of a hub's server.

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
        options: dict[str, Any] = {
            "socket_timeout": _SILENCE_S,
            "socket_connect_timeout": _ANSWER_S,
        }
        forever = {"retry": Retry(ConstantBackoff(_RETRY_S), -1)}
        super().__init__(url, channel=f"mmt-hubs {group}", redis_options=options | forever)
        self.deliver = deliver
        self._begun = False
        once: dict[str, Any] = {"retry": Retry(NoBackoff(), 0)}
        try:
            self._probe = redis.asyncio.Redis.from_url(url, **options, **once)
        except ValueError:  # its message may quote a part of the password
            raise InputError(
                "--redis: this is no URL of Redis; allowed is redis://USER:PASSWORD@HOST:PORT, "
                "with the characters / ? # of a password as %2F %3F %23"
            ) from None
        self.reached = False
        """Whether Redis answered when it was last asked."""

    def initialize(self) -> None:
        """Start to receive from the hubs; the server calls this again at its first listener."""
        if not self._begun:
            self._begun = True
            super().initialize()

    async def check(self) -> str | None:
        """Publish an empty message on the hubs' channel; return None, or why that fails.

        Until Redis is `reached`, also check that the message is received.
        """
        try:
            async with asyncio.timeout(_ANSWER_S), AsyncExitStack() as stack:
                if not self.reached:
                    heard = await stack.enter_async_context(self._probe.pubsub())
                    await heard.subscribe(self.channel)
                await self._probe.publish(self.channel, _NOTHING)
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

    async def publish(self, event: str, data: Any) -> None:
        """Send an event to every hub, or to this one alone while Redis is lost."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_ANSWER_S):
                await self.emit(
                    event, data, namespace=HUBS_NAMESPACE, ignore_queue=not self.reached
                )

    async def close(self) -> None:
        """Close the connections to Redis."""
        if self._begun:
            await cancel_until_ended([self.thread])
        for each in (self.pubsub, self.redis, self._probe):
            if each is not None:
                with suppress(RedisError, OSError):
                    await each.aclose()


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
