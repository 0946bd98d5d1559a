"""Listeners that count what comes and keep no model, many in one process.

``python -m mmt_lab.sharing.counting URL COUNT SECONDS`` lets so many join, twenty a second, prints
``{"joined_s": ...}`` as soon as all are there, and at the end of the leader's session, or after so
many seconds, what each has found.
"""

import asyncio
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from mmt.core.errors import InputError, MmtError
from mmt.scene.sharing_tables import Listening
from mmt.sharing.client import ListenerClient
from mmt.sharing.replica import ModelReplica
from mmt.texture.model.difference import digest
from mmt.texture.model.file_arrays import file_arrays

_JOINING_HZ: Final = 20.0


class CountingReplica(ModelReplica):
    """Check that every change follows on the state before, and keep its digest alone.

    The digest is the leader's, of its own arrays; a listener that has had the whole and each change
    since has a model with that digest, or finds that it has not.
    """

    def __init__(self) -> None:
        super().__init__()
        self._file = self._digest = b""

    def take_whole(self, message: object) -> None:
        """Take a whole model."""
        taken = self._stamped(message)
        self._file, self._digest = taken["file"], b""

    def take_change(self, message: object) -> None:
        """Take a change.

        Raises
        ------
        InputError
            It does not follow on what is here.
        """
        if not isinstance(message, Mapping) or message["since"] != self.number or not self.number:
            raise InputError("a change is missing")
        self._digest = self._stamped(message)["digest"]

    def digest(self) -> str:
        """Return the digest of the model in hexadecimal digits, empty before there is one."""
        if not self.number:
            return ""
        return (self._digest or digest(file_arrays(self._file))).hex()

    def _stamped(self, message: Any) -> Any:
        self.number, self.made_ns = message["number"], message["made_ns"]
        return message


@dataclass
class Count:
    """What one listener has found.

    Attributes
    ----------
    lags_ms
        From the making of each change of the model until it was there, by one clock.
    number, digest
        Of its last state.
    wholes, changes, states, rejected
        Messages; `rejected` of those that did not fit.
    problem
        Why it could not connect, empty where it could.
    """

    lags_ms: list[float] = field(default_factory=list)
    number: int = 0
    digest: str = ""
    wholes: int = 0
    changes: int = 0
    states: int = 0
    rejected: int = 0
    problem: str = ""


class Counter:
    """One listener.

    Parameters
    ----------
    url
        Where the model is shared.
    """

    def __init__(self, url: str) -> None:
        self.replica = CountingReplica()
        self.ended = asyncio.Event()
        self.problem = ""
        self._lags_ms: list[float] = []
        self._client = ListenerClient(
            Listening(url=url, patience_s=60.0), on_model=self._take, on_event=self._say
        )
        self._client.replica = self.replica

    async def join(self, after_s: float = 0.0) -> None:
        """Connect after so many seconds."""
        await asyncio.sleep(after_s)
        try:
            await self._client.connect()
        except MmtError as error:
            self.problem = str(error)
            self.ended.set()

    async def leave(self) -> Count:
        """Disconnect; return what was found."""
        await self._client.close()
        client, replica = self._client, self.replica
        return Count(
            self._lags_ms,
            replica.number,
            replica.digest(),
            client.wholes,
            client.changes,
            client.states,
            client.rejected,
            self.problem,
        )

    def _take(self) -> None:
        if self._client.changes:
            self._lags_ms.append(1e-6 * (time.monotonic_ns() - self.replica.made_ns))

    def _say(self, text: str) -> None:
        if "has ended" in text:
            self.ended.set()


async def count(url: str, listeners: int, longest_s: float) -> list[Count]:
    """Let listeners join, and count until the session has ended for each of them."""
    begun_s = time.monotonic()
    crowd = [Counter(url) for _ in range(listeners)]
    await asyncio.gather(*(one.join(index / _JOINING_HZ) for index, one in enumerate(crowd)))
    print(json.dumps({"joined_s": time.monotonic() - begun_s}), flush=True)
    ends = [asyncio.create_task(one.ended.wait()) for one in crowd]
    _, late = await asyncio.wait(ends, timeout=longest_s)
    for each in late:
        each.cancel()
    return list(await asyncio.gather(*(one.leave() for one in crowd)))


def main() -> None:
    """Run the listeners of the command line."""
    url, listeners, longest_s = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    print(json.dumps([asdict(each) for each in asyncio.run(count(url, listeners, longest_s))]))


if __name__ == "__main__":
    main()
