"""The end of a session, which comes once and has one outcome."""

import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterable
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, Final, TypeVar

from mmt.core.errors import FAILED, MmtError

_ASK_AGAIN_S: Final = 1.0

Result = TypeVar("Result")


def start_task(
    coroutine: Coroutine[Any, Any, Result], running: set[asyncio.Task[Result]]
) -> asyncio.Task[Result]:
    """Start a task, and keep it among the running ones until it ends: the loop does not."""
    task = asyncio.get_running_loop().create_task(coroutine)
    running.add(task)
    task.add_done_callback(running.discard)
    return task


async def cancel_until_ended(tasks: Iterable[asyncio.Future[Any]]) -> None:
    """Cancel tasks and wait until all have ended, whatever their results.

    A running task is cancelled again once a second, because a library may turn a cancellation
    into a timeout of its own and go on.
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
        """Why the session ended; until then, the default outcome."""
        self.fault: Exception | None = None
        """The exception that ended the session, or None if it did not fail."""
        self._reached = asyncio.Event()
        self._deadline: asyncio.TimerHandle | None = None

    @property
    def reached(self) -> bool:
        """Whether the session has ended."""
        return self._reached.is_set()

    @property
    def awaits_peer(self) -> bool:
        """Whether the peer is gone, and the timeout for its return is running or has expired."""
        return self._deadline is not None

    async def wait(self) -> None:
        """Wait for the end."""
        await self._reached.wait()

    async def wait_or_cancel(self, task: asyncio.Future[Any]) -> bool:
        """Wait for a task, or cancel it at the end; return whether the task finished first.

        Raises
        ------
        Exception
            The task's exception.
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
        """Run a slow call, such as connecting a device, in a thread; return early at the end.

        Parameters
        ----------
        work
            The slow call. If the session ends first, the thread goes on without being awaited.
        undo
            Called in the thread if the session ended before `work` returned.

        Raises
        ------
        Exception
            The exception of `work`, if raised before the end.
        """
        outcome: Future[None] = Future()
        outcome.set_running_or_notify_cancel()  # so that the end cancels the waiter, not this

        def run() -> None:
            try:
                work()
            except BaseException as error:  # noqa: BLE001 - raised in the waiting task
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
        """Raise the fault if it is no `MmtError` and therefore an error in the program."""
        if self.fault is not None and not isinstance(self.fault, MmtError):
            raise self.fault

    def start_timeout(self, timeout_s: float, on_timeout: Callable[[], None]) -> None:
        """Call `on_timeout` after this time, unless the timeout is cancelled or restarted."""
        self.cancel_timeout()
        self._deadline = asyncio.get_running_loop().call_later(timeout_s, on_timeout)

    def cancel_timeout(self) -> None:
        """Cancel the timeout, if one runs."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
