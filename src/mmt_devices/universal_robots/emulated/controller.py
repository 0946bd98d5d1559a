"""The ports of a UR controller in software, for the real ur_rtde to connect to.

The library has the ports built in: 29999 for the dashboard, 30003 for scripts, 30004 for RTDE.
The controller therefore listens at a loopback address of its own.

Sources: Universal Robots, "Real-Time Data Exchange (RTDE) guide" and "Dashboard Server e-Series";
the source of ur_rtde 1.6 (MIT) for what the library sends.
"""

import asyncio
import random
import threading
import time
from collections.abc import Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from mmt.core.arrays import Vector
from mmt.core.errors import MmtError
from mmt.core.running.ticking import Ticker
from mmt_devices.universal_robots.emulated.arm import (
    EMERGENCY_STOP,
    PLAYING,
    POWER_OFF,
    PROTECTIVE_STOP,
    ArmTip,
    EmulatedArm,
)
from mmt_devices.universal_robots.emulated.ports import (
    RATE_HZ,
    VERSION,
    DashboardConnection,
    PortConnection,
    RtdeConnection,
    ScriptConnection,
)
from mmt_devices.universal_robots.frame import SceneFrame

if TYPE_CHECKING:
    from mmt.testing.emulated import Clockwork
    from mmt.testing.emulated.lab import World

DASHBOARD_PORT: Final = 29999
SCRIPT_PORT: Final = 30003
RTDE_PORT: Final = 30004

_SERIAL_NUMBER: Final = "20225500001"
_ORIGIN_MM: Final[Vector] = (-120.0, -430.0, 150.0)
_ROTATION_RAD: Final[Vector] = (0.0, 0.0, 0.5)
"""The tip's frame in the frame of the base, see `SceneFrame`."""
_TRIES: Final = 50
_MOST_CYCLES: Final = 10
"""Cycles that are made up for after a hold-up."""


_PORTS: Final[dict[int, type[PortConnection]]] = {
    DASHBOARD_PORT: DashboardConnection,
    SCRIPT_PORT: ScriptConnection,
    RTDE_PORT: RtdeConnection,
}


class EmulatedUrController:
    """A controller of the e-Series with its arm, at a loopback address of its own.

    Parameters
    ----------
    tip
        Tip that the arm moves.
    seed
        Seed of the noise.
    """

    def __init__(self, tip: ArmTip, *, seed: int = 1) -> None:
        frame = SceneFrame(_ORIGIN_MM, _ROTATION_RAD)
        self.arm = EmulatedArm(tip, frame, noise_n=0.05, seed=seed)
        self.host = ""
        self.remote = True
        """Whether the arm is in remote control."""
        self.refuses_version = False
        """Whether the controller speaks only the first version of RTDE."""
        self.silent = False
        """Whether no data is sent, as if the network cable were unplugged."""
        self._began_ns = time.monotonic_ns()
        self._cycles = 0
        self._servers: list[asyncio.Server] = []
        self.connections: list[PortConnection] = []
        self._loop = asyncio.new_event_loop()
        self._ready, self._ended = threading.Event(), asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="UR controller", daemon=True)

    # --- life

    def start(self) -> None:
        """Start listening at an address whose ports are free.

        Raises
        ------
        MmtError
            No such address was found.
        """
        self._thread.start()
        self._ready.wait()
        if not self.host:
            raise MmtError("no loopback address has the ports of a UR controller free")

    def stop(self) -> None:
        """Stop, and free the ports."""
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join()

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the robot's driver finds the arm and its surface."""
        place = {"origin_mm": list(_ORIGIN_MM), "rotation_rad": list(_ROTATION_RAD)}
        return {"host": self.host, **place}

    def unplug(self) -> None:
        """Close every connection and refuse new ones."""
        self._await(self._close_all())

    def plug(self) -> None:
        """Listen again at the same address, as after a restart: no program runs."""
        self.arm.end_program()
        self._await(self._listen(self.host))

    def switch_to_local(self) -> None:
        """Switch to local control, as a person does at the pendant; the program ends."""
        self.remote = False
        self.arm.end_program()

    # --- what its ports do

    def run_script(self) -> None:
        """Run the control script if the arm is in remote control."""
        if self.remote:
            self.arm.start_program()

    def set_registers(self, values: dict[str, Any]) -> None:
        """Take input registers."""
        self.arm.set_registers(values, self._time_s(time.monotonic_ns()))

    def answer(self, line: str) -> str:
        """Return the dashboard server's answer to a line."""
        arm = self.arm
        if line == "stop":
            arm.end_program()
        stops = {PROTECTIVE_STOP: "PROTECTIVE_STOP", EMERGENCY_STOP: "ROBOT_EMERGENCY_STOP"}
        answers = {
            "PolyscopeVersion": "URSoftware {}.{}.{}.{} (Mar 28 2022)".format(*VERSION),
            "get serial number": _SERIAL_NUMBER,
            "is in remote control": str(self.remote).lower(),
            "robotmode": f"Robotmode: {'POWER_OFF' if arm.mode == POWER_OFF else 'RUNNING'}",
            "running": f"Program running: {str(arm.runtime_state == PLAYING).lower()}",
            "safetystatus": f"Safetystatus: {stops.get(arm.safety, 'NORMAL')}",
            "stop": "Stopped",
        }
        return answers.get(line, f'could not understand: "{line}"')

    # --- its thread

    def _time_s(self, now_ns: int) -> float:
        return (now_ns - self._began_ns) / 1e9

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    def _await(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _serve(self) -> None:
        chance = random.SystemRandom()
        for _ in range(_TRIES):
            host = (
                f"127.{chance.randint(64, 127)}.{chance.randint(0, 255)}.{chance.randint(1, 254)}"
            )
            try:
                await self._listen(host)
            except OSError:
                await self._close_all()
                continue
            self.host = host
            break
        self._ready.set()
        if self.host:
            ticker = Ticker(1_000_000_000 // RATE_HZ, self._run_cycles, statistics=False)
            ticker.start()
            await self._ended.wait()
            ticker.stop()
            await self._close_all()

    def _run_cycles(self, elapsed: int) -> None:
        for _ in range(min(elapsed, _MOST_CYCLES)):
            self._cycles += 1
            now_ns = time.monotonic_ns()
            time_s = self._time_s(now_ns)
            self.arm.step(time_s, now_ns, 1.0 / RATE_HZ)
            if not self.silent:
                fields = self.arm.fields(time_s)
                for connection in self.connections:
                    connection.send_state(fields, self._cycles)

    async def _listen(self, host: str) -> None:
        for port, kind in _PORTS.items():
            made = partial(kind, self)
            self._servers.append(await self._loop.create_server(made, host, port))

    async def _close_all(self) -> None:
        for server in self._servers:
            server.close()
        self._servers.clear()
        for connection in self.connections:
            connection.transport.abort()
        await asyncio.sleep(0.0)  # in which the connections are closed


def in_lab(world: "World", seed: int, _clockwork: "Clockwork") -> EmulatedUrController:
    """Return the arm of the virtual lab, in place of its robot."""
    world.take_robot()
    return EmulatedUrController(world, seed=seed)
