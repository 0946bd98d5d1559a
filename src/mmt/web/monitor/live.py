"""The live monitor: the newest motion, force and vibration, and the viewers that get them.

A viewer's queue holds one message of each kind. A newer message replaces one that was not sent
yet, so a slow viewer skips states; it neither delays other viewers nor fills the memory.
"""

import asyncio
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.frames import acceleration_samples
from mmt.devices.leader_reports import InterfaceState
from mmt.scene import Scene, Texture
from mmt.texture.signals.biquad import VIBRATION_CUTOFF_HZ, BiquadFilter, butterworth_high_pass
from mmt.web.page_server import pack

if TYPE_CHECKING:
    from aiohttp import web


_MOST_BLOCKS: Final = 500
"""Half a second at one frame per message; the monitor empties the buffer more often."""

MOST_SAMPLES: Final = 512
"""Most samples of vibration in a message, as many as the page shows, also in a fast replay."""

Motion = tuple[float, float, float]
"""Velocity along the two axes of the surface (mm/s), and normal force (N)."""


class LiveMessages:
    """Makes live messages from the data since the last one.

    The 1 kHz path calls the `add` methods; without viewers they return at once.

    Parameters
    ----------
    scene
        Defines the axis of the vibration and the surface's normal.
    """

    def __init__(self, scene: Scene) -> None:
        texture = scene.texture or Texture()
        self.watched = False
        """Whether there are viewers."""
        self.state: InterfaceState | None = None
        """State of the hand at the last tick, or None if the hand is not read."""
        self._frames: deque[RecordArray] = deque(maxlen=_MOST_BLOCKS)
        self._outputs: deque[FloatArray] = deque(maxlen=_MOST_BLOCKS)
        self._rate_hz = float(scene.session.rate_hz)
        self._normal = "xyz".index(texture.normal)
        self._tangential = [axis for axis in range(3) if axis != self._normal]
        self._axis = "xyz".index(texture.normal if texture.axis == "dft321" else texture.axis)
        vibration_hz = float(scene.session.acceleration_rate_hz)
        self._filter = BiquadFilter(butterworth_high_pass(VIBRATION_CUTOFF_HZ, vibration_hz))
        self._measured = 0
        self._played = 0

    def add_frames(self, frames: RecordArray) -> None:
        """Store frames (n,) that have just arrived."""
        if self.watched:
            self._frames.append(frames)

    def add_output(self, vibration_m_s2: FloatArray) -> None:
        """Store samples (n,) that were written to the actuator."""
        if self.watched:
            self._outputs.append(vibration_m_s2)

    def restart(self) -> None:
        """Discard old data, and store data from now on, for the first viewer."""
        self._frames.clear()
        self._outputs.clear()
        self._filter.reset()
        self.watched = True

    def make(self, header: dict[str, Any]) -> bytes:
        """Return the next message; its counts of samples let the page detect missed ones."""
        frames = _joined(self._frames) if self._frames else None
        played = np.concatenate(self._outputs) if self._outputs else np.zeros(0)
        self._frames.clear()
        self._outputs.clear()
        self._played += len(played)
        measured = self._vibration(frames)
        values = {
            **header,
            **self._motion(frames),
            "measured_count": self._measured,
            "played_count": self._played,
        }
        return pack("live", values, {"measured": measured, "played": played[-MOST_SAMPLES:]})

    def _vibration(self, frames: RecordArray | None) -> FloatArray:
        """Return the high-passed acceleration (n,) of the newest frames, n <= `MOST_SAMPLES`."""
        if frames is None or not _has(frames, "acceleration_m_s2"):
            return np.zeros(0)
        samples = acceleration_samples(frames)
        self._measured += len(samples)
        return np.array(self._filter.steps(samples[-MOST_SAMPLES:, self._axis].tolist()))

    def _motion(self, frames: RecordArray | None) -> dict[str, Any]:
        """Return force and position of the newest frame, and the hand's speed and force."""
        table: dict[str, Any] = {"point": None, "contact": False}
        if frames is not None and _has(frames, "position_mm"):
            table["position_mm"] = [round(x, 3) for x in frames["position_mm"][-1].tolist()]
        if frames is not None and _has(frames, "force_n"):
            table["force_n"] = [round(x, 4) for x in frames["force_n"][-1].tolist()]
        motion = self._hand() or self._streamed(frames)
        if motion is not None:
            x, y, force_n = motion
            table["velocity_mm_s"] = [round(x, 2), round(y, 2)]
            table["point"] = [round((x * x + y * y) ** 0.5, 2), round(force_n, 4)]
            table["contact"] = force_n > 0.0
        return table

    def _hand(self) -> Motion | None:
        """Return the velocity and force of the leader's hand, or None if it was not read."""
        state = self.state
        if state is None:
            return None
        x, y = (state.velocity_mm_s[axis] for axis in self._tangential)
        return x, y, state.force_n if state.contact else 0.0

    def _streamed(self, frames: RecordArray | None) -> Motion | None:
        """Return the mean velocity and force of the newest frames, or None."""
        if frames is None or not (_has(frames, "position_mm") and _has(frames, "force_n")):
            return None
        frames = frames[-MOST_SAMPLES:]
        path = frames["position_mm"][:, self._tangential]
        duration_s = (int(frames["sequence"][-1]) - int(frames["sequence"][0])) / self._rate_hz
        if duration_s <= 0:
            return None
        x, y = ((path[-1] - path[0]) / duration_s).tolist()
        force_n = float(frames["force_n"][:, self._normal].mean())
        return x, y, max(0.0, force_n)


def _joined(blocks: Sequence[RecordArray]) -> RecordArray:
    """Join blocks of one dtype by their bytes, which takes a hundredth of the time."""
    return np.frombuffer(b"".join(block.tobytes() for block in blocks), blocks[-1].dtype)


def _has(frames: RecordArray, channel: str) -> bool:
    return len(frames) > 0 and channel in (frames.dtype.names or ())


MOST_VIEWERS: Final = 8
"""Largest number of viewers at once."""


class Viewer:
    """Queue of messages to one browser."""

    def __init__(self) -> None:
        self._waiting: dict[str, bytes] = {}
        self._news = asyncio.Event()
        self._closing = False

    def offer(self, kind: str, message: bytes) -> None:
        """Queue a message, replacing an older one of its kind; never blocks."""
        self._waiting[kind] = message
        self._news.set()

    def close(self) -> None:
        """Send the queued messages, then stop."""
        self._closing = True
        self._news.set()

    async def send(self, socket: "web.WebSocketResponse") -> None:
        """Send messages until `close`.

        Raises
        ------
        ConnectionError
            The other side has disconnected.
        """
        while True:
            await self._news.wait()
            self._news.clear()
            while self._waiting:
                kind = next(iter(self._waiting))
                await socket.send_bytes(self._waiting.pop(kind))
            if self._closing:
                return


class Viewers:
    """All viewers of a session.

    Attributes
    ----------
    retained
        The newest message of each kind that a new viewer needs, in order of first publication.
    """

    def __init__(self) -> None:
        self._viewers: set[Viewer] = set()
        self.retained: dict[str, bytes] = {}
        self.ended = False

    def __len__(self) -> int:
        return len(self._viewers)

    def publish(self, kind: str, message: bytes, *, retain: bool = True) -> None:
        """Queue a message for all viewers; with `retain` also for later ones."""
        if retain:
            self.retained[kind] = message
        for viewer in self._viewers:
            viewer.offer(kind, message)

    def add(self) -> Viewer:
        """Return a new viewer with the retained messages in its queue."""
        viewer = Viewer()
        self._viewers.add(viewer)
        for kind, message in self.retained.items():
            viewer.offer(kind, message)
        return viewer

    def remove(self, viewer: Viewer) -> None:
        """Remove a viewer that has disconnected."""
        self._viewers.discard(viewer)

    def close(self) -> None:
        """Send all queued messages, and admit no further viewers."""
        self.ended = True
        for viewer in self._viewers:
            viewer.close()
