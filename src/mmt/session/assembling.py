"""Join what arrives in small pieces into the blocks of a session file."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.session.mcap_writer import FRAMES_PER_BLOCK

_SAMPLE_BYTES = 4


class FrameAssembler:
    """Join frames into blocks of 20 and hand these on, each with its first frame's time."""

    def __init__(self, dtype: np.dtype[Any], write: Callable[[RecordArray, int], None]) -> None:
        self._dtype = dtype
        self._write = write
        self._block_bytes = FRAMES_PER_BLOCK * dtype.itemsize
        self._waiting = bytearray()
        self._log_time_ns = 0

    def add(self, log_time_ns: int, data: bytes) -> None:
        """Take frames as bytes and hand on every block that is full."""
        if not self._waiting:
            self._log_time_ns = log_time_ns
        self._waiting += data
        while len(self._waiting) >= self._block_bytes:
            self._hand_on(self._block_bytes)
            self._log_time_ns = log_time_ns

    def flush(self) -> None:
        """Hand on what is left, a block that is not full."""
        if self._waiting:
            self._hand_on(len(self._waiting))

    def _hand_on(self, size: int) -> None:
        block = bytes(self._waiting[:size])
        del self._waiting[:size]
        self._write(np.frombuffer(block, dtype=self._dtype), self._log_time_ns)


class OutputAssembler:
    """Join output samples of one mode into blocks of 20 or a little more."""

    def __init__(self, write: Callable[[int, str, FloatArray], None]) -> None:
        self._write = write
        self._waiting = bytearray()
        self._mode = ""
        self._time_ns = 0

    def add(self, time_ns: int, mode: str, data: bytes) -> None:
        """Take samples as little-endian single precision; a new mode begins a new block."""
        if mode != self._mode:
            self.flush()
        if not self._waiting:
            self._mode, self._time_ns = mode, time_ns
        self._waiting += data
        if len(self._waiting) >= FRAMES_PER_BLOCK * _SAMPLE_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand on what is left."""
        if self._waiting:
            samples = np.frombuffer(bytes(self._waiting), dtype="<f4").astype(np.float64)
            self._waiting.clear()
            self._write(self._time_ns, self._mode, samples)
