"""A further event of small records, which only some scenes put on the wire."""

import time
from collections.abc import Callable

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.link.events import call
from mmt.link.protocol import encode_event
from mmt.link.reading import BlockReader


class ExtraEvent:
    """One side of such an event: check what comes, encode what goes.

    Parameters
    ----------
    event
        Its name, the same on both sides.
    dtype
        Of its records, as `BlockReader` takes it.
    take
        Called with checked records, shape (n,), read-only, in order.
    began
        Called when a connection begins, perhaps to another that counts from its own start.
    """

    def __init__(
        self,
        event: str,
        dtype: np.dtype[np.void],
        take: Callable[[RecordArray], None],
        began: Callable[[], None],
    ) -> None:
        self.event = event
        self._dtype = dtype
        self._take = take
        self._began = began
        self._reader = BlockReader(dtype, f"{event} records")

    def restart(self) -> None:
        """Expect a new connection."""
        self._reader.restart()
        self._began()

    def read(self, arguments: tuple[object, ...], on_error: Callable[[Exception], None]) -> None:
        """Take the arguments of an event, as anybody may have sent them."""
        records = self._reader.read(arguments, time.monotonic_ns())
        if records is not None:
            call(self._take, records, on_error=on_error)

    def encode(self, records: RecordArray) -> bytes:
        """Return the message that carries records (n,), n at most 100.

        Raises
        ------
        ValueError
            They are of another dtype.
        """
        if records.dtype != self._dtype:
            message = f"{self.event} records are of dtype {records.dtype}: allowed is {self._dtype}"
            raise ValueError(message)
        return encode_event(self.event, records.tobytes())
