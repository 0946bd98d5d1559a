"""An emulated microcontroller that plays samples, on a pseudo-terminal for its driver."""

import random
from collections import deque
from collections.abc import Callable
from typing import Final

from mmt.devices.haptuator.framing import BoardReport, BoardSamples, Decoder, Reset, encode
from mmt.testing.emulated import with_flipped_bit
from mmt.testing.emulated.serial_port import EmulatedSerialDevice

_PERIOD_NS: Final = 1_000_000
_REPORT_PERIODS: Final = 5
_CAPACITY: Final = 1024
_HISTORY: Final = 400_000
_MODULUS: Final = 0x10000


class EmulatedHaptuatorBoard(EmulatedSerialDevice):
    """A board that buffers samples, plays them by its own clock and reports.

    While its buffer is empty it plays zero. Through a pseudo-terminal bytes arrive at once,
    whatever the baud rate.

    Parameters
    ----------
    rate_hz
        Sampling rate of its converter.
    clock_ppm
        How much too fast its clock runs.
    listener
        Called with each sample that goes to the converter, in the board's thread.
    """

    def __init__(
        self,
        rate_hz: int = 8000,
        *,
        clock_ppm: float = 0.0,
        listener: Callable[[int], None] | None = None,
    ) -> None:
        super().__init__(_PERIOD_NS)
        self.garbled = 0.0
        """Share of the transfers, in either direction, in which a bit is flipped."""
        self.halved = 0.0
        """Share of the transfers, in either direction, whose second half gets lost."""
        self.stalled = False
        """Whether the firmware hangs: it plays nothing and sends nothing."""
        self.frozen = False
        """Whether it repeats its last report and does nothing else."""
        self._listener = listener
        self._rate_hz = rate_hz
        self._per_ns = rate_hz * 1e-9 * (1.0 + 1e-6 * clock_ppm)
        self._random = random.Random(1)  # noqa: S311 - faults, no secret
        self._decoder = Decoder()
        self._buffer: deque[int] = deque()
        self._played: deque[int] = deque(maxlen=_HISTORY)
        self._due = 0.0
        self._last_ns: int | None = None
        self._periods = 0
        self._begin()

    def restart(self) -> None:
        """Restart without being unplugged, as after a dip of its supply."""
        self._begin()

    def count_from(self, sequence: int) -> None:
        """Behave as if this frame had been the newest one."""
        self._sequence = sequence % _MODULUS

    def played(self) -> list[int]:
        """Return the newest samples that went to the converter, full scale is 32767."""
        return list(self._played)

    def _begin(self) -> None:
        self._buffer.clear()
        self._sequence = self._underruns = self._lost = 0
        self._running = False

    def _step(self, due_ns: int, received: bytes) -> None:
        last_ns = due_ns if self._last_ns is None else self._last_ns
        self._last_ns = due_ns
        if self.stalled:
            return
        if self.frozen:
            self._report()
            return
        for message in self._decoder.feed(self._garble(received)):
            if isinstance(message, Reset):
                self._begin()
            elif isinstance(message, BoardSamples):
                self._accept(message)
        self._due += (due_ns - last_ns) * self._per_ns
        for _ in range(int(self._due)):
            self._play()
        self._due -= int(self._due)
        self._report()

    def _report(self) -> None:
        self._periods += 1
        if self._periods % _REPORT_PERIODS == 0:
            fill = len(self._buffer)
            report = BoardReport(
                self._rate_hz, _CAPACITY, fill, self._sequence, self._underruns, self._lost
            )
            self.write(self._garble(encode(report)))

    def _accept(self, message: BoardSamples) -> None:
        missing = (message.sequence - self._sequence - 1) % _MODULUS
        self._lost = (self._lost + missing) % _MODULUS
        self._sequence = message.sequence
        if len(self._buffer) + len(message.values) > _CAPACITY:
            self._lost = (self._lost + 1) % _MODULUS
            return
        self._buffer.extend(message.values)
        self._running = True

    def _play(self) -> None:
        value = 0
        if self._buffer:
            value = self._buffer.popleft()
        elif self._running:
            self._running = False
            self._underruns = (self._underruns + 1) % _MODULUS
        self._played.append(value)
        if self._listener is not None:
            self._listener(value)

    def _garble(self, content: bytes) -> bytes:
        if content and self._random.random() < self.halved:
            content = content[: len(content) // 2]
        if not content or self._random.random() >= self.garbled:
            return content
        return with_flipped_bit(content, self._random)
