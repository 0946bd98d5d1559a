"""Devices merged into frames in real time, however busy the machine is."""

import re
import time

import numpy as np

from mmt.core.arrays import Vector
from mmt.devices.streaming.source import DeviceSource

PATIENCE_S = 20.0


class Arm:
    """A robot that stands still."""

    def connect(self):
        """Stand."""

    calibrate = close = connect

    def read(self):
        return (0.0, 0.0, 0.0)

    def write(self, position_mm):
        """Stay."""


class RunningSource:
    """A source that holds where a device is lost, ticked by hand; either sensor may be None."""

    command_mm: Vector | None = None
    """What the robot is told at each tick."""

    def __init__(self, force_sensor, accelerometer, robot=None, samples_per_frame=1):
        channels = [("force", force_sensor), ("acceleration", accelerometer)]
        self.told = []
        """Whether a device is lost now, and a sentence."""
        self.source = DeviceSource(
            robot or Arm(),
            force_sensor,
            accelerometer,
            ("position", *(name for name, sensor in channels if sensor is not None)),
            on_lost="hold",
            samples_per_frame=samples_per_frame,
        )
        self.source.on_loss(lambda lost, sentence, _: self.told.append((lost, sentence)))
        self._last_ns = 0

    @property
    def is_lost(self) -> bool:
        return bool(self.told) and self.told[-1][0]

    def start(self):
        self.source.start(0)
        self._last_ns = time.monotonic_ns()

    def stop(self):
        self.source.close()

    def run_until_told(self, *patterns):
        """Tick until a loss has been told for each of these reasons.

        Others may come first: a machine that has no time for a device is a silent device.
        """
        before = len(self.told)
        self.run(
            lambda _: all(
                any(lost and re.search(pattern, sentence) for lost, sentence in self.told[before:])
                for pattern in patterns
            )
        )

    def run(self, done):
        """Tick until it is done, which is told how many frames there are."""
        blocks = []
        deadline = time.monotonic() + PATIENCE_S
        number = 0
        while not done(number):
            assert time.monotonic() < deadline, (number, self.told, self.source.summary)
            time.sleep(0.0005)
            now_ns = time.monotonic_ns()
            elapsed = (now_ns - self._last_ns) // 1_000_000
            if elapsed:
                self._last_ns += elapsed * 1_000_000
                blocks.append(self.source.step(elapsed, now_ns, self.command_mm))
                number += len(blocks[-1])
        return np.concatenate(blocks)
