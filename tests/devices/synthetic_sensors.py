"""Sensors on clocks of their own, in simulated time: when what arrives, and what was true."""

import random
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from mmt.devices.protocols import SensorReading
from mmt.devices.streaming.source import DeviceSource

START_NS = 5_000_000_000_000
MS = 1_000_000


@dataclass
class Time:
    """A clock that tests move; as a module's ``time`` it moves on with each look."""

    now_ns: int = START_NS

    def monotonic_ns(self):
        self.now_ns += 100_000
        return self.now_ns

    @property
    def still(self) -> SimpleNamespace:
        """The same time, which does not pass by being asked for."""
        return SimpleNamespace(monotonic_ns=lambda: self.now_ns, sleep=self.sleep)

    def sleep(self, seconds):
        self.now_ns += round(seconds * 1e9)


class SyntheticSensor:
    """Measures ``(host's time of the physical instant in ms, 0, 0)`` at its own rate.

    Parameters
    ----------
    rate_hz, drift
        Nominal rate, and how much longer than nominal its periods are.
    transport_ns, jitter_ns
        Least time from the stamp to the arrival, and the mean of what is on top; one in a
        hundred takes up to a millisecond more.
    """

    def __init__(
        self,
        rate_hz,
        drift=0.0,
        *,
        time=None,
        latency_ns=200_000,
        transport_ns=20_000,
        jitter_ns=50_000.0,
        seed=1,
    ):
        self.latency_ns = latency_ns
        self.time = time or Time()
        self.faults = {}
        self.calls = []
        self.stalled = False
        self.error = None
        self.connect_error = None
        self._random = random.Random(seed)
        self._nominal_ns = 1e9 / rate_hz
        self._true_ns = self._nominal_ns * (1 + drift)
        self._transport_ns, self._jitter_ns = transport_ns, jitter_ns
        self._offset_ns = self._random.randrange(10**12)
        self._phase = self._random.random()
        self._next = 0
        self._pending = None
        self._last_arrival_ns = 0.0

    def connect(self):
        self.calls.append("connect")
        if self.connect_error is not None:
            raise self.connect_error
        self.error = None

    def calibrate(self):
        self.calls.append("calibrate")

    def close(self):
        self.calls.append("close")

    def read(self):
        return self.arrived(self.time.now_ns)

    def arrived(self, now_ns):
        """What has come by now and was not read before; what a stalled sensor measures is gone."""
        if self.error is not None:
            raise self.error
        come = []
        while True:
            if self._pending is None:
                self._pending = self._measure()
            if self._pending[0] > now_ns:
                return come
            if not self.stalled:
                come.append(self._pending[1])
            self._pending = None

    def _measure(self):
        stamp_true_ns = START_NS + (self._next + self._phase) * self._true_ns
        stamp_ns = self._offset_ns + round(self._next * self._nominal_ns)
        self._next += 1
        late = self._random.expovariate(1 / self._jitter_ns) if self._jitter_ns else 0.0
        if self._random.random() < 0.01:
            late += self._random.random() * MS
        arrival_ns = max(self._last_arrival_ns, stamp_true_ns + self._transport_ns + late)
        self._last_arrival_ns = arrival_ns
        value = ((stamp_true_ns - self.latency_ns - START_NS) / 1e6, 0.0, 0.0)
        return arrival_ns, SensorReading(stamp_ns, value)


def simulated_time(patch):
    """Put simulated time in the place of a source's own, and return it."""
    made = Time()
    patch.setattr("mmt.devices.streaming.source.time", made)
    patch.setattr("mmt.devices.streaming.slots.time", made.still)
    return made


class SteppedSource:
    """A source of devices in simulated time, started, and ticked by hand."""

    def __init__(self, time, *devices, channels, on_lost="hold", samples=1):
        self.time = time
        self.told = []
        """Whether a device is lost now, a sentence, and whether that is about the robot."""
        self.source = DeviceSource(*devices, channels, on_lost=on_lost, samples_per_frame=samples)
        self.source.on_loss(lambda *told: self.told.append(told))
        self.source.start(0)

    def run(self, ticks, elapsed=1):
        """Return the frames of so many ticks."""
        blocks = []
        for _ in range(ticks):
            self.time.now_ns += elapsed * MS
            blocks.append(self.source.step(elapsed, self.time.now_ns, (0.0, 0.0, 0.0)))
        return np.concatenate(blocks)
