"""Process that reads the emulated devices by the real drivers and forms frames.

The process receives a job. It reports when it streams, and each device that is lost or back. The
commands ``begin`` and ``end`` delimit the measurement; at ``finish`` it sends frames and figures.
"""

import asyncio
import sys
import time
from multiprocessing.connection import Connection
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray
from mmt.core.frames import CHANNELS
from mmt.core.running.process import be_real_time, prefer_even_ticks
from mmt.core.running.ticking import Ticker
from mmt.devices.drivers import load_device
from mmt.devices.streaming.source import PERIOD_NS, DeviceSource
from mmt.testing.emulated.labjack_u6 import EmulatedU6Voltages
from mmt.testing.emulated.openhaptics.hd import EmulatedHd
from mmt.testing.emulated.remote_u6 import RemoteU6
from mmt.testing.emulated.robot import DatagramRobot

_COMMAND_MM: Final = (0.0, 0.0, 5.0)


class FrameReader:
    """Read devices at 1 kHz and keep the frames.

    Parameters
    ----------
    job
        ``robot``, ``force_sensor`` and ``accelerometer``, each with ``driver`` and ``options``;
        ``realtime``: whether to tick by real-time scheduling; ``bare_s``: seconds for which an
        empty tick is measured first.
    pipe
        Pipe to the measuring process.
    """

    def __init__(self, job: dict[str, Any], pipe: Connection) -> None:
        self._pipe = pipe
        self._emulations: list[DatagramRobot | EmulatedHd | RemoteU6] = []
        robot, force, acceleration = (
            self._load(job[key]) for key in ("robot", "force_sensor", "accelerometer")
        )
        self.sensors = {"force_sensor": force, "accelerometer": acceleration}
        self.source = DeviceSource(robot, force, acceleration, CHANNELS, on_lost="hold")
        self.source.on_loss(self._note)
        self.source.on_late_frames(self._keep)
        self.ticker = Ticker(PERIOD_NS, self._tick)
        self._frames: list[RecordArray] = []
        self._formed: list[tuple[int, int]] = []
        self._measured: dict[str, float] = {}
        self._begun = (0, 0, 0)
        self._keeps = False
        self._realtime: bool = job["realtime"]
        self._bare_s: float = job["bare_s"]

    async def run(self) -> None:
        """Stream until ``finish``; then send the frames and the figures."""
        loop = asyncio.get_running_loop()
        prefer_even_ticks()
        if self._realtime:
            be_real_time()
        try:
            self._measured["bare_share"] = await _bare_share(self._bare_s)
            self.source.start(time.monotonic_ns())
            self.ticker.start()
            loop.add_reader(self._pipe.fileno(), self._read_command)
            self._pipe.send({"ready": True})
            await self.ticker.wait()
        finally:
            self.ticker.stop()
            loop.remove_reader(self._pipe.fileno())
            self.source.close()
        formed = [at_ns for at_ns, count in self._formed for _ in range(count)]
        self._pipe.send(
            {
                "finished": True,
                "frames": np.concatenate(self._frames) if self._frames else np.empty(0),
                "formed_ns": np.array(formed, dtype=np.int64),
                **self._measured,
                "devices": self.source.summary,
                "latency_ns": {key: one.latency_ns for key, one in self.sensors.items()},
                "late_share_1ms": self.ticker.statistics.late_share_1ms,
                "imported": sorted({"numba", "scipy"} & set(sys.modules)),
            }
        )

    def _read_command(self) -> None:
        try:
            word = self._pipe.recv()
        except EOFError:  # the measuring process has gone
            word = "finish"
        emulated_ns = sum(each.own_ns for each in self._emulations)
        now = (time.monotonic_ns(), time.process_time_ns(), emulated_ns)
        if word == "begin":
            self._begun, self._keeps = now, True
        elif word == "end":
            wall_ns, busy_ns, emulated_ns = (now[i] - self._begun[i] for i in range(3))
            self._measured["core_share"] = busy_ns / wall_ns
            self._measured["emulated_share"] = emulated_ns / wall_ns
            self._keeps = False
            self._pipe.send({"ended": True})
        else:
            self.ticker.stop()

    def _tick(self, elapsed: int) -> None:
        self._keep(self.source.step(elapsed, time.monotonic_ns(), _COMMAND_MM))

    def _keep(self, frames: RecordArray) -> None:
        if self._keeps and len(frames):
            self._frames.append(frames)
            self._formed.append((time.monotonic_ns(), len(frames)))

    def _note(self, lost: bool, sentence: str, _of_robot: bool) -> None:
        self._pipe.send({"lost": lost, "at_ns": time.monotonic_ns(), "sentence": sentence})

    def _load(self, device: dict[str, Any]) -> Any:
        options = dict(device["options"])
        if device["driver"] == "datagrams":
            robot = DatagramRobot(**options)
            self._emulations.append(robot)
            return robot
        if device["driver"] == "openhaptics":
            self._emulations.append(EmulatedHd())
        if "board" in options:
            EmulatedU6Voltages.at = RemoteU6(options["board"].pop("address"))
            self._emulations.append(EmulatedU6Voltages.at)
        return load_device(device["driver"], options)


async def _bare_share(duration_s: float) -> float:
    """Return the share of a core that an empty tick takes."""
    ticker = Ticker(PERIOD_NS, lambda _elapsed: None)
    ticker.start()
    begun_ns, busy_ns = time.monotonic_ns(), time.process_time_ns()
    await asyncio.sleep(duration_s)
    share = (time.process_time_ns() - busy_ns) / (time.monotonic_ns() - begun_ns)
    ticker.stop()
    return share


async def read(pipe: Connection) -> None:
    """Receive a job from the pipe, and read its devices."""
    await FrameReader(pipe.recv(), pipe).run()
