"""The end of a session: it comes once, with one outcome."""

import asyncio
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Final

from mmt.core.errors import FAILED, MmtError

_ASK_AGAIN_S: Final = 1.0


async def cancel_until_ended(tasks: Iterable[asyncio.Future[Any]]) -> None:
    """Cancel tasks and wait for their end, whatever it is.

    A task is asked again once a second: a library that turns the cancellation of one step into a
    timeout of its own would otherwise go on for good.
    """
    every = set(tasks)
    pending = every
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=_ASK_AGAIN_S)
    await asyncio.gather(*every, return_exceptions=True)


class Ending:
    """The end of a session; several parts may cause it, and the first one sets the outcome.

    Parameters
    ----------
    outcome
        Outcome of a session that ends without another one.
    """

    def __init__(self, outcome: str) -> None:
        self.outcome = outcome
        """Why it ended, or the outcome it has unless another one is set."""
        self.fault: Exception | None = None
        """The exception that ended it, None where it did not fail."""
        self._reached = asyncio.Event()
        self._deadline: asyncio.TimerHandle | None = None

    @property
    def reached(self) -> bool:
        """Whether the session has ended."""
        return self._reached.is_set()

    @property
    def awaits_peer(self) -> bool:
        """Whether the peer is gone and the session waits, or has waited, for its return."""
        return self._deadline is not None

    async def wait(self) -> None:
        """Wait for the end."""
        await self._reached.wait()

    async def wait_or_cancel(self, task: asyncio.Future[Any]) -> bool:
        """Wait for a task, which the end cancels; return whether it was done before.

        Raises
        ------
        Exception
            What the task raises.
        """
        ended = asyncio.create_task(self.wait())
        try:
            await asyncio.wait([task, ended], return_when=asyncio.FIRST_COMPLETED)
            if task.done():
                task.result()
            return task.done()
        finally:
            task.cancel()
            ended.cancel()
            await asyncio.gather(task, ended, return_exceptions=True)

    async def call_in_thread(self, work: Callable[[], None], undo: Callable[[], object]) -> None:
        """Call what may take long, such as connecting a device, in a thread; or wait for the end.

        Parameters
        ----------
        work
            What is done; at the end it is left to itself.
        undo
            Called in the thread if the end came before `work` returned.

        Raises
        ------
        Exception
            What `work` raises before the end.
        """
        outcome: Future[None] = Future()
        outcome.set_running_or_notify_cancel()  # the end cancels those who wait, not this

        def run() -> None:
            try:
                work()
            except BaseException as error:  # noqa: BLE001 - raised for who waits
                outcome.set_exception(error)
            else:
                outcome.set_result(None)
            if self.reached:
                with suppress(Exception):
                    undo()

        threading.Thread(target=run, name="connecting", daemon=True).start()
        await self.wait_or_cancel(asyncio.wrap_future(outcome))

    def stop(self, outcome: str) -> None:
        """End the session."""
        if not self.reached:
            self.outcome = outcome
            self._reached.set()

    def fail(self, fault: Exception) -> None:
        """End the session as failed, because of this exception."""
        self.fault = self.fault or fault
        self.stop(f"{FAILED}{fault}")

    def raise_unexpected(self) -> None:
        """Raise the fault unless it is an `MmtError`: then it is an error in the program."""
        if self.fault is not None and not isinstance(self.fault, MmtError):
            raise self.fault

    def start_timeout(self, timeout_s: float, on_timeout: Callable[[], None]) -> None:
        """Call `on_timeout` after this time, unless the timeout is cancelled or restarted."""
        self.cancel_timeout()
        self._deadline = asyncio.get_running_loop().call_later(timeout_s, on_timeout)

    def cancel_timeout(self) -> None:
        """Cancel the timeout; nothing happens where none runs."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
