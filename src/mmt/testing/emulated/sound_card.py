"""An emulated sound card: the interface of `sounddevice` for one output, on a clock of its own.

An `EmulatedSoundCard` takes the library's place. Its time either runs by itself (`start`), or by
`advance`, as fast as the computer can.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray

Block = npt.NDArray[np.float32]

_PAUSE_S: Final = 0.001


class PortAudioError(Exception):
    """The library's error."""


class EmulatedSoundCard:
    """One card with one stream at a time.

    Parameters
    ----------
    channels
        Number of its outputs.
    clock_ppm
        How much too fast its clock runs.
    dac_latency_s
        Time from filling a block to its first frame at the converter.
    history_s
        Length of the record of played samples.
    """

    PortAudioError = PortAudioError
    name = "Emulated card"

    def __init__(
        self,
        channels: int = 2,
        *,
        clock_ppm: float = 0.0,
        dac_latency_s: float = 0.004,
        history_s: float = 10.0,
    ) -> None:
        self.channels = channels
        self.dac_latency_s = dac_latency_s
        self.begun_s = 0.0
        """Monotonic time (s) at which its own time was 0; set by `start`."""
        self._history_s = history_s
        self._speed = 1.0 + 1e-6 * clock_ppm
        self._plugged = True
        self._known = self._found = True
        self._stalled = False
        self._underflow = False
        self._stream: EmulatedStream | None = None
        self._lock = threading.RLock()
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        self._time_s = 0.0
        self._due_frames = 0.0
        self._blocks: deque[Block] = deque()
        self._held = 0

    # --- the physical side

    def start(self) -> None:
        """Let time run by itself."""
        self.begun_s = time.monotonic() - self._time_s
        self._ended.clear()
        self._thread = threading.Thread(target=self._run, name="emulated sound card", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Let time stand still."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def advance(self, seconds: float) -> None:
        """Let time pass, and ask the stream for the blocks that fall due."""
        with self._lock:
            self._time_s += seconds
            stream = self._stream
            if stream is None or not stream.active or self._stalled:
                return
            self._due_frames += seconds * self._speed * stream.samplerate
            while stream.active and self._due_frames >= stream.blocksize:
                self._due_frames -= stream.blocksize
                self._play(stream)

    def unplug(self) -> None:
        """Take the card away: its stream ends, and it cannot be opened; the library lists it on."""
        with self._lock:
            self._plugged = self._found = False
            if self._stream is not None:
                self._stream.finish()

    def plug(self) -> None:
        """Bring it back under another number, which the library finds once it searches again."""
        self._plugged = True

    def stall(self, stalled: bool = True) -> None:
        """Keep the stream open, but ask for nothing; or ask again."""
        self._stalled = stalled

    def underflow(self) -> None:
        """Report with the next block that the card's own buffer ran dry."""
        self._underflow = True

    def played(self, channel: int = 1) -> FloatArray:
        """Return the played samples of the history, full scale is 1, shape (frames,)."""
        with self._lock:
            blocks = [block[:, channel - 1] for block in self._blocks]
        return np.concatenate(blocks).astype(np.float64) if blocks else np.zeros(0)

    def clock_ns(self) -> int:
        """Return the card's time (ns)."""
        return round(1e9 * self._time_s)

    def _run(self) -> None:
        last = time.monotonic()
        while not self._ended.wait(_PAUSE_S):
            now = time.monotonic()
            self.advance(now - last)
            last = now

    def _play(self, stream: "EmulatedStream") -> None:
        block = np.full((stream.blocksize, stream.channels), np.nan, dtype=np.float32)
        now_s = self._time_s
        times = SimpleNamespace(currentTime=now_s, outputBufferDacTime=now_s + self.dac_latency_s)
        status = SimpleNamespace(output_underflow=self._underflow)
        self._underflow = False
        stream.callback(block, stream.blocksize, times, status)
        self._blocks.append(block)
        self._held += len(block)
        while self._held > self._history_s * stream.samplerate:
            self._held -= len(self._blocks.popleft())

    # --- the library's side

    def query_devices(self, device: str | int | None = None, kind: str | None = None) -> Any:
        """Return the card, by name or number, or the list of all."""
        entry = {"index": 0, "name": self.name, "max_output_channels": self.channels}
        if device is None and kind is None:
            return [entry] if self._known else []
        if not self._known:
            raise PortAudioError("Error querying device -1")
        if device not in {None, 0} and str(device).lower() not in self.name.lower():
            raise ValueError(f"No output device matching {device!r}")
        return entry

    def _terminate(self) -> None:
        self._known = False

    def _initialize(self) -> None:
        self._known = self._found = self._plugged

    def OutputStream(self, **options: Any) -> "EmulatedStream":  # noqa: N802 - the library's name
        """Open the card."""
        if not self._found:
            raise PortAudioError("Error opening OutputStream: Device unavailable")
        return EmulatedStream(self, **options)


class EmulatedStream:
    """An open output; see `sounddevice.OutputStream`."""

    def __init__(
        self,
        card: EmulatedSoundCard,
        *,
        samplerate: int,
        blocksize: int,
        channels: int,
        callback: Callable[[Block, int, Any, Any], None],
        finished_callback: Callable[[], None],
        **_: Any,
    ) -> None:
        self._card = card
        self.samplerate = samplerate
        self.blocksize = blocksize
        self.channels = channels
        self.callback = callback
        self._finished = finished_callback
        self.active = False
        self.latency = card.dac_latency_s

    def start(self) -> None:
        """Begin to ask for blocks."""
        with self._card._lock:
            if self._card._stream is not None and self._card._stream.active:
                raise PortAudioError("Error starting stream: Device unavailable")
            self._card._stream = self
            self.active = True

    def finish(self) -> None:
        """End, as at the card's loss."""
        with self._card._lock:
            if self.active:
                self.active = False
                self._finished()

    def abort(self) -> None:
        """End at once."""
        self.finish()

    def close(self) -> None:
        """Release the card."""
        self.finish()
        with self._card._lock:
            if self._card._stream is self:
                self._card._stream = None
