"""Join single frames and samples into the blocks of a session file."""

from collections.abc import Callable


class BlockAssembler:
    """Join frames or samples, as bytes, into blocks.

    Parameters
    ----------
    block_bytes
        Size of a block.
    write
        Gets each block, the time (ns) of its first addition, and its mode.
    divides
        Whether an addition is divided where a block is full. If not, a block ends with the
        addition that fills it, and may be longer.
    """

    def __init__(
        self, block_bytes: int, write: Callable[[bytes, int, str], None], *, divides: bool
    ) -> None:
        self._block_bytes = block_bytes
        self._write = write
        self._divides = divides
        self._waiting = bytearray()
        self._mode = ""
        self._time_ns = 0

    def add(self, time_ns: int, data: bytes, mode: str = "") -> None:
        """Append bytes and write every full block; a new mode begins a new block."""
        if mode != self._mode:
            self.flush()
        if not self._waiting:
            self._mode, self._time_ns = mode, time_ns
        self._waiting += data
        while len(self._waiting) >= self._block_bytes:
            self._write_block(self._block_bytes if self._divides else len(self._waiting))
            self._time_ns = time_ns

    def flush(self) -> None:
        """Write the rest as a shorter block."""
        if self._waiting:
            self._write_block(len(self._waiting))

    def _write_block(self, size: int) -> None:
        block = bytes(self._waiting[:size])
        del self._waiting[:size]
        self._write(block, self._time_ns, self._mode)
