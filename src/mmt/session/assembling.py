"""Join single frames and samples into the blocks of a session file."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.session.mcap.writer import FRAMES_PER_BLOCK

_SAMPLE_BYTES = 4


class BlockAssembler:
    """Join frames into blocks of 20; `write` gets each block and its first frame's log time."""

    def __init__(self, dtype: np.dtype[Any], write: Callable[[RecordArray, int], None]) -> None:
        self._dtype = dtype
        self._write = write
        self._block_bytes = FRAMES_PER_BLOCK * dtype.itemsize
        self._waiting = bytearray()
        self._log_time_ns = 0

    def add(self, log_time_ns: int, data: bytes) -> None:
        """Append frames as bytes and write every full block."""
        if not self._waiting:
            self._log_time_ns = log_time_ns
        self._waiting += data
        while len(self._waiting) >= self._block_bytes:
            self._write_block(self._block_bytes)
            self._log_time_ns = log_time_ns

    def flush(self) -> None:
        """Write the remaining frames as a shorter block."""
        if self._waiting:
            self._write_block(len(self._waiting))

    def _write_block(self, size: int) -> None:
        block = bytes(self._waiting[:size])
        del self._waiting[:size]
        self._write(np.frombuffer(block, dtype=self._dtype), self._log_time_ns)


class OutputAssembler:
    """Join output samples of one mode into blocks as long as 20 frames, or slightly longer."""

    def __init__(
        self, write: Callable[[int, str, FloatArray], None], samples_per_frame: int = 1
    ) -> None:
        self._write = write
        self._block_bytes = FRAMES_PER_BLOCK * samples_per_frame * _SAMPLE_BYTES
        self._waiting = bytearray()
        self._mode = ""
        self._time_ns = 0

    def add(self, time_ns: int, mode: str, data: bytes) -> None:
        """Append little-endian float32 samples; a new mode begins a new block."""
        if mode != self._mode:
            self.flush()
        if not self._waiting:
            self._mode, self._time_ns = mode, time_ns
        self._waiting += data
        if len(self._waiting) >= self._block_bytes:
            self.flush()

    def flush(self) -> None:
        """Write the remaining samples."""
        if self._waiting:
            samples = np.frombuffer(bytes(self._waiting), dtype="<f4").astype(np.float64)
            self._waiting.clear()
            self._write(self._time_ns, self._mode, samples)
