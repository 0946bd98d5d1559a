"""The conversation with the service, in a thread of its own with a loop of its own."""

import asyncio
import contextlib
import threading
import time
from collections.abc import Awaitable, Callable
from typing import Any, Final, Generic

import aiohttp

from mmt.core.errors import DeviceLost, MmtError
from mmt.core.realtime import follow_real_time
from mmt.core.ticking import Ticker
from mmt.devices.haply.messages import OtherFormatError, parse
from mmt.devices.haply.servo import AnyServo

PERIOD_NS: Final = 1_000_000

_CONNECT_S: Final = 3.0
_FIRST_S: Final = 3.0
_READY_S: Final = 10.0
_FAREWELL_S: Final = 0.2
_JOIN_S: Final = 3.0
_SHOWN: Final = 60


class ServiceLink(Generic[AnyServo]):
    """One WebSocket to the service: a message each millisecond, unless an answer is still due.

    Parameters
    ----------
    address
        URL of the service.
    timeout_ms
        For how long an answer may be due.
    make_servo
        Makes the servo of the service's first message; what it raises comes out of `start`.
    """

    def __init__(
        self, address: str, timeout_ms: float, make_servo: Callable[[dict[str, Any]], AnyServo]
    ) -> None:
        self._address, self._timeout_ms = address, timeout_ms
        self._make_servo = make_servo
        self.servo: AnyServo | None = None
        self._failure: Exception | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[None] | None = None
        self._answered = threading.Event()
        """Set by the first answer, and at the end."""
        self._stopped = threading.Event()
        self._asked = False
        self._turns_waited = 0
        self._thread = threading.Thread(target=self._run, name="inverse3", daemon=True)

    def start(self) -> AnyServo:
        """Connect, and return the servo after the first answer.

        Raises
        ------
        MmtError
            There is no service, or none that can be used; the message says what to do.
        """
        self._thread.start()
        if not self._answered.wait(_READY_S):
            raise MmtError(f"the Haply Inverse Service at {self._address} does not get ready")
        if self._failure is not None:
            raise self._failure
        if self.servo is None:
            raise MmtError(f"the conversation with {self._address} has ended")
        return self.servo

    def check(self) -> None:
        """Raise where the conversation has ended.

        Raises
        ------
        DeviceLost
            The service has gone or is stuck.
        MmtError
            The driver itself failed.
        """
        if self._failure is not None:
            if isinstance(self._failure, MmtError):
                raise DeviceLost(str(self._failure)) from self._failure
            raise MmtError(f"the driver failed: {self._failure!r}") from self._failure

    def stop(self) -> None:
        """Take the force away and end; calling it twice is harmless."""
        self._stopped.set()
        loop, task = self._loop, self._task
        if loop is not None and task is not None and not task.done():
            with contextlib.suppress(RuntimeError):  # it has just closed by itself
                loop.call_soon_threadsafe(task.cancel)
        if self._thread.is_alive():
            self._thread.join(_JOIN_S)

    def _run(self) -> None:
        follow_real_time()
        try:
            asyncio.run(self._converse())
        except asyncio.CancelledError:
            pass  # it was stopped, or `_failure` says why
        except Exception as error:  # noqa: BLE001 - told by `start` or `check`
            self._failure = error
        finally:
            self._answered.set()

    async def _converse(self) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        if self._stopped.is_set():
            return
        async with aiohttp.ClientSession() as session:
            socket = await self._open(session)
            try:
                self.servo = servo = await self._first(socket)
                try:
                    await self._exchange(socket, servo)
                finally:
                    await _in_time(socket.send_str(servo.release()))
            finally:
                await _in_time(socket.close())

    async def _open(self, session: aiohttp.ClientSession) -> aiohttp.ClientWebSocketResponse:
        try:
            async with asyncio.timeout(_CONNECT_S):
                return await session.ws_connect(self._address, autoping=True)
        except aiohttp.WSServerHandshakeError as error:
            raise MmtError(
                f"what answers at {self._address} is no Haply Inverse Service (it says "
                f"{error.status} {error.message!r}): correct the option 'address'"
            ) from error
        except (aiohttp.ClientError, OSError, TimeoutError, ValueError) as error:
            reason = str(error) or f"no answer within {_CONNECT_S:g} s"
            raise MmtError(
                f"the Haply Inverse Service does not answer at {self._address} ({reason}): start "
                "it (the Haply Hub does; on Linux 'systemctl start haply-inverse-service'), or "
                "correct the option 'address'"
            ) from error

    async def _first(self, socket: aiohttp.ClientWebSocketResponse) -> AnyServo:
        try:
            async with asyncio.timeout(_FIRST_S):
                text = await self._next(socket)
        except TimeoutError:
            raise MmtError(
                f"the Haply Inverse Service at {self._address} does not say which devices there "
                f"are, within {_FIRST_S:g} s: restart it"
            ) from None
        try:
            return self._make_servo(parse(text))
        except OtherFormatError:
            raise MmtError(
                f"the service at {self._address} speaks the format 3.0: give the port of the "
                "format 3.1 and later, 10001 unless it was changed, by the option 'address', or "
                "install a newer Haply Inverse Service"
            ) from None
        except ValueError as error:
            raise MmtError(
                f"what answers at {self._address} is no Haply Inverse Service: its first message "
                f"is {text[:_SHOWN]!r} ({error}); correct the option 'address'"
            ) from error

    async def _exchange(self, socket: aiohttp.ClientWebSocketResponse, servo: AnyServo) -> None:
        """Talk until one of the two fails, or this is cancelled."""
        due = asyncio.Event()
        ticker = Ticker(PERIOD_NS, lambda _: self._turn(due), statistics=False)
        talking = [
            asyncio.ensure_future(self._speak(socket, servo, due)),
            asyncio.ensure_future(self._hear(socket, servo)),
        ]
        ticker.start()
        try:
            await asyncio.wait(talking, return_when=asyncio.FIRST_COMPLETED)
            for each in talking:
                if each.done():
                    each.result()
        finally:
            ticker.stop()
            for each in talking:
                each.cancel()
            await asyncio.gather(*talking, return_exceptions=True)

    def _turn(self, due: asyncio.Event) -> None:
        """Let the next message go, unless the service is stuck.

        Turns are counted, not time: a process that was held up has not waited for an answer.
        """
        if self._asked:
            self._turns_waited += 1
            if self._turns_waited * PERIOD_NS > self._timeout_ms * 1e6 and self._task is not None:
                self._failure = MmtError(
                    f"the Haply Inverse Service at {self._address} has not answered for "
                    f"{self._timeout_ms:g} ms: it is stuck or overloaded; restart it, end what "
                    "loads this machine, or raise 'timeout_ms'"
                )
                self._task.cancel()
        else:
            due.set()

    async def _speak(
        self, socket: aiohttp.ClientWebSocketResponse, servo: AnyServo, due: asyncio.Event
    ) -> None:
        text = servo.greet()
        try:
            while True:
                self._turns_waited, self._asked = 0, True
                await socket.send_str(text)
                due.clear()
                await due.wait()
                text = servo.speak(time.monotonic_ns())
        except (aiohttp.ClientError, ConnectionError) as error:
            raise self._gone(str(error)) from error

    async def _hear(self, socket: aiohttp.ClientWebSocketResponse, servo: AnyServo) -> None:
        while True:
            text = await self._next(socket)
            self._asked = False
            servo.hear(text)
            self._answered.set()

    async def _next(self, socket: aiohttp.ClientWebSocketResponse) -> str:
        """Return the next text, "" for a message that is none."""
        message = await socket.receive()
        if message.type is aiohttp.WSMsgType.TEXT:
            return str(message.data)
        if message.type is aiohttp.WSMsgType.BINARY:
            return ""
        raise self._gone(str(socket.exception() or "") or f"code {socket.close_code}")

    def _gone(self, reason: str) -> MmtError:
        return MmtError(
            f"the Haply Inverse Service at {self._address} has closed the connection ({reason}): "
            "see whether it still runs"
        )


async def _in_time(saying: Awaitable[object]) -> None:
    """Do what the service may not want to hear any more, but not for long."""
    try:
        async with asyncio.timeout(_FAREWELL_S):
            await saying
    except (aiohttp.ClientError, ConnectionError, TimeoutError):
        return
