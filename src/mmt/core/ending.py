"""How a session ends: once, for one reason."""

import asyncio
from collections.abc import Callable

from mmt.core.errors import FAILED, MmtError


class Ending:
    """The end of a session, which several parts may bring about; the first one names it.

    Parameters
    ----------
    outcome
        What to call an end that nobody named.
    """

    def __init__(self, outcome: str) -> None:
        self.outcome = outcome
        """Why it ended, or would end if nobody says otherwise."""
        self.fault: Exception | None = None
        """What made it fail, None where nothing did."""
        self._reached = asyncio.Event()
        self._deadline: asyncio.TimerHandle | None = None

    @property
    def reached(self) -> bool:
        """Whether the session has ended."""
        return self._reached.is_set()

    @property
    def patient(self) -> bool:
        """Whether somebody has gone whom the session waits, or has waited, for."""
        return self._deadline is not None

    async def wait(self) -> None:
        """Wait for the end."""
        await self._reached.wait()

    def stop(self, outcome: str) -> None:
        """End the session."""
        if not self.reached:
            self.outcome = outcome
            self._reached.set()

    def fail(self, fault: Exception) -> None:
        """End the session because something in it does not work."""
        self.fault = self.fault or fault
        self.stop(f"{FAILED}{fault}")

    def raise_mistake(self) -> None:
        """Raise the fault where it is none of devices or files, but a mistake in the program."""
        if self.fault is not None and not isinstance(self.fault, MmtError):
            raise self.fault

    def be_patient(self, within_s: float, give_up: Callable[[], None]) -> None:
        """Call `give_up` when so much time has passed, unless `settle` or this comes before."""
        self.settle()
        self._deadline = asyncio.get_running_loop().call_later(within_s, give_up)

    def settle(self) -> None:
        """Wait for nobody any more."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
