"""The process that talks to the Haply Inverse Service, on behalf of a driver.

It is a separate process because each message with its answer holds the interpreter for a fifth of a
millisecond. In the driver's process, the ticks would have to wait for that.
"""

import asyncio
import contextlib
import time
from collections import Counter
from collections.abc import Awaitable, Mapping
from typing import Any, Final

import aiohttp

from mmt.core.errors import MmtError
from mmt.core.running.process import be_real_time
from mmt.core.running.ticking import Ticker
from mmt.devices.driver_process import COUNT, LOST, STATE, DriverPipes, run_process
from mmt_devices.inverse3.exchange import CALIBRATED, FOUND
from mmt_devices.inverse3.messages import (
    NAMES,
    OtherFormatError,
    kind_of,
    listed,
    parse,
    version_of,
)
from mmt_devices.inverse3.servo import (
    ChosenDevice,
    ForceServo,
    Inverse3PositionServo,
    Inverse3Servo,
)

PERIOD_NS: Final = 1_000_000

_CONNECT_S: Final = 3.0
_FAREWELL_S: Final = 0.2
_SHOWN: Final = 60


class Conversation:
    """One WebSocket to the service: a message each millisecond, unless an answer is still due.

    Parameters
    ----------
    arguments
        Arguments from the driver's `ServiceLink`.
    pipes
        Pipes to the driver; the conversation ends when the driver has gone.
    """

    def __init__(self, arguments: Mapping[str, Any], pipes: DriverPipes) -> None:
        self._address: str = arguments["address"]
        self._timeout_ms: float = arguments["timeout_ms"]
        self._first_s: float = arguments["first_s"]
        self._arguments, self._pipes = arguments, pipes
        self._servo: Inverse3Servo | None = None
        self._told: Counter[str] = Counter()
        self._is_lost = False
        self._failure: MmtError | None = None
        self._asked = False
        self._turns_waited = 0
        self._due = asyncio.Event()
        self._turns = Ticker(PERIOD_NS, lambda _: self._turn(), statistics=False)

    async def run(self) -> None:
        """Talk until the driver has gone.

        Raises
        ------
        MmtError
            The service or device is missing, unusable, gone or stuck; the message says what to do.
        """
        talking = asyncio.ensure_future(self._converse())
        self._turns.start()
        turning = asyncio.ensure_future(self._turns.wait())
        await asyncio.wait([talking, turning], return_when=asyncio.FIRST_COMPLETED)
        self._turns.stop()
        talking.cancel()  # no effect if it has ended by itself
        with contextlib.suppress(asyncio.CancelledError):
            await talking
        await turning
        if self._failure is not None:
            raise self._failure

    async def _converse(self) -> None:
        async with aiohttp.ClientSession() as session:
            socket = await self._open(session)
            try:
                self._servo = servo = await self._first(socket)
                self._pipes.send(FOUND, f"{servo.kind} {servo.device}")
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

    async def _first(self, socket: aiohttp.ClientWebSocketResponse) -> Inverse3Servo:
        try:
            async with asyncio.timeout(self._first_s):
                text = await self._next(socket)
        except TimeoutError:
            raise MmtError(
                f"the Haply Inverse Service at {self._address} does not say which devices there "
                f"are, within {self._first_s:g} s: restart it"
            ) from None
        try:
            return self._choose(parse(text))
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

    def _choose(self, message: dict[str, Any]) -> Inverse3Servo:
        """Return a servo for the wanted device among those of the first message."""
        arguments = self._arguments
        there, wanted = listed(message), arguments["device"]
        names = ", ".join(f"{name!r} ({kind_of(entry)})" for name, entry in there.items())
        where = f"the Haply Inverse Service at {self._address}"
        if not there:
            raise MmtError(
                f"{where} knows no Inverse3: plug it in and switch it on; the Haply Hub shows it "
                "when it is there"
            )
        if wanted is None and len(there) > 1:
            raise MmtError(f"{where} has {names}: name one by the option 'device'")
        device = next(iter(there)) if wanted is None else wanted
        if device not in there:
            raise MmtError(f"{where} has no device {device!r}, but {names}: correct 'device'")
        entry, commands = dict(there[device]), arguments["commands"]
        version = version_of(message, entry) if commands == "auto" else commands
        servo = _SERVOS[arguments["role"]]
        return servo(ChosenDevice(device, NAMES[version], entry), **arguments["servo"])

    async def _exchange(
        self, socket: aiohttp.ClientWebSocketResponse, servo: Inverse3Servo
    ) -> None:
        """Send and receive until one of the two fails, or until cancelled."""
        talking = [
            asyncio.ensure_future(self._speak(socket, servo)),
            asyncio.ensure_future(self._handle_answer(socket, servo)),
        ]
        try:
            await asyncio.wait(talking, return_when=asyncio.FIRST_COMPLETED)
            for each in talking:
                if each.done():
                    each.result()
        finally:
            for each in talking:
                each.cancel()
            await asyncio.gather(*talking, return_exceptions=True)

    def _turn(self) -> None:
        """Take the driver's commands; allow the next message once the last one is answered.

        The time-out counts turns, so that a pause of this process is not taken for a stuck service.
        """
        commands = self._pipes.receive()
        if commands is None:
            self._turns.stop()
            return
        servo = self._servo
        for kind, *body in commands:
            if servo is not None and kind == CALIBRATED:
                servo.needs_calibration = True
            elif servo is not None:
                servo.command_ns, servo.command = body
        if not self._asked:
            self._due.set()
            return
        self._turns_waited += 1
        if self._turns_waited * PERIOD_NS > self._timeout_ms * 1e6:
            self._failure = MmtError(
                f"the Haply Inverse Service at {self._address} has not answered for "
                f"{self._timeout_ms:g} ms: it is stuck or overloaded; restart it, end what "
                "loads this machine, or raise 'timeout_ms'"
            )
            self._turns.stop()

    async def _speak(self, socket: aiohttp.ClientWebSocketResponse, servo: Inverse3Servo) -> None:
        text = servo.first_message()
        try:
            while True:
                self._turns_waited, self._asked = 0, True
                await socket.send_str(text)
                self._due.clear()
                await self._due.wait()
                text = servo.next_message(time.monotonic_ns())
        except (aiohttp.ClientError, ConnectionError) as error:
            raise self._gone(str(error)) from error

    async def _handle_answer(
        self, socket: aiohttp.ClientWebSocketResponse, servo: Inverse3Servo
    ) -> None:
        while True:
            text = await self._next(socket)
            self._asked = False
            servo.handle_answer(text)
            self._report(servo)

    def _report(self, servo: Inverse3Servo) -> None:
        """Send the driver new counts, the state, and why the device is lost."""
        if servo.counts != self._told:
            for what in (servo.counts - self._told).elements():
                self._pipes.send(COUNT, what)
            self._told = servo.counts.copy()
        self._pipes.send(STATE, servo.state())
        problem = servo.problem()
        if problem and not self._is_lost:
            self._is_lost = self._pipes.send(LOST, problem)

    async def _next(self, socket: aiohttp.ClientWebSocketResponse) -> str:
        """Return the next text, or "" for a binary message."""
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
    """Await a last message to the service, briefly, and ignore a closed connection."""
    try:
        async with asyncio.timeout(_FAREWELL_S):
            await saying
    except (aiohttp.ClientError, ConnectionError, TimeoutError):
        return


_SERVOS: Final[dict[str, type[Inverse3Servo]]] = {
    "handle": ForceServo,
    "robot": Inverse3PositionServo,
}


def run(arguments: dict[str, Any], pipes: DriverPipes) -> None:
    """Talk to the service until the driver has gone."""
    if arguments["real_time"]:
        with contextlib.suppress(MmtError):
            be_real_time()
    asyncio.run(Conversation(arguments, pipes).run())


if __name__ == "__main__":
    run_process(run, "the Inverse3")
