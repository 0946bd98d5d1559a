"""The service's part of an arm or a handle: the real driver, in a process of its own.

Its first line of input is the job, as JSON. It prints a line of JSON when it reads; ``begin`` says
from when on to keep what is read and commanded, and with the end of its input it writes that.
"""

import asyncio
import json
import sys
import time
from typing import Any, Final

import numpy as np

from mmt.core.process import prefer_even_ticks
from mmt.core.realtime import be_real_time
from mmt.core.ticking import Ticker
from mmt.devices.drivers import load_device
from mmt.devices.protocols import Pacing, Vector
from mmt.devices.source import PERIOD_NS
from mmt_lab.bench.device_path.children import say

STEP_TICKS: Final = 61
"""From one step of the command to the next: it is at rest by then, and meets any phase of a
device that runs at a rate of its own."""
_STEP: Final = 0.2
"""mm, or N: an arm is there within some 20 ms, by the bounds of its driver."""


class ArmReader:
    """Read a device at 1 kHz, and command a step now and then.

    Parameters
    ----------
    job
        ``driver``, ``options`` and ``role`` of the device; ``realtime``, whether it ticks by
        real-time scheduling.
    """

    def __init__(self, job: dict[str, Any]) -> None:
        self._device = load_device(job["driver"], job["options"], role=job["role"])
        self._is_handle = job["role"] == "handle"
        self._realtime: bool = job["realtime"]
        self._ticker = Ticker(PERIOD_NS, self._tick, statistics=False)
        self._ticks, self._next_step = 0, STEP_TICKS
        self._command: Vector = (0.0, 0.0, 0.0)
        self._keeps = False
        self._ticked: list[tuple[int, int]] = []
        self._places: list[Vector] = []
        self._read_ns: list[int] = []
        self._stepped_ns: list[int] = []

    async def run(self, file: str) -> None:
        """Read until standard input ends; then write what was found."""
        loop = asyncio.get_running_loop()
        try:
            self._device.connect()
            self._device.calibrate()
            prefer_even_ticks()
            if self._realtime:
                be_real_time()
            if isinstance(self._device, Pacing):
                self._device.await_turn()
            self._ticker.start()
            loop.add_reader(sys.stdin.fileno(), self._read_command)
            say({"ready": True})
            await self._ticker.wait()
        finally:
            self._ticker.stop()
            loop.remove_reader(sys.stdin.fileno())
            self._device.close()
        np.savez(
            file,
            ticked=np.array(self._ticked, dtype=np.int64),
            places_mm=np.array(self._places),
            read_ns=np.array(self._read_ns, dtype=np.int64),
            stepped_ns=np.array(self._stepped_ns, dtype=np.int64),
        )
        say({"written": True})

    def _read_command(self) -> None:
        if sys.stdin.readline():
            self._keeps = True
        else:
            self._ticker.stop()

    def _tick(self, elapsed: int) -> None:
        now_ns = time.monotonic_ns()
        self._ticks += elapsed
        place = self._device.read(elapsed).position_mm if self._is_handle else self._device.read()
        read_ns = time.monotonic_ns()
        if self._ticks >= self._next_step:
            self._next_step = self._ticks + STEP_TICKS
            self._command = (_STEP - self._command[0], 0.0, 0.0)
            if self._keeps:
                self._stepped_ns.append(time.monotonic_ns())
        self._device.write(self._command)
        if self._keeps:
            self._ticked.append((self._ticks, now_ns))
            self._places.append(place)
            self._read_ns.append(read_ns)


if __name__ == "__main__":
    job = json.loads(sys.stdin.readline())
    asyncio.run(ArmReader(job).run(job["file"]))
