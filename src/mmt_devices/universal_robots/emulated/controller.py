"""The ports of a UR controller in software, for the real ur_rtde to connect to.

The library has the ports built in: 29999 for the dashboard, 30003 for scripts, 30004 for RTDE.
The controller therefore listens at a loopback address of its own.

Sources: Universal Robots, "Real-Time Data Exchange (RTDE) guide" and "Dashboard Server e-Series";
the source of ur_rtde 1.6 (MIT) for what the library sends.
"""

import random
import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from mmt.core.arrays import Vector
from mmt.core.errors import MmtError
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
    from mmt.testing.emulated.clockwork import Clockwork
    from mmt.testing.emulated.world import World

DASHBOARD_PORT: Final = 29999
SCRIPT_PORT: Final = 30003
RTDE_PORT: Final = 30004

_SERIAL_NUMBER: Final = "20225500001"
_ORIGIN_MM: Final[Vector] = (-120.0, -430.0, 150.0)
_ROTATION_RAD: Final[Vector] = (0.0, 0.0, 0.5)
"""The tip's frame in the frame of the base, see `SceneFrame`."""
_TRIES: Final = 50
_MOST_WAITING: Final = 1 << 16


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
        self._selector = selectors.DefaultSelector()
        self._listeners: list[socket.socket] = []
        self.connections: list[PortConnection] = []
        self._plugged = True
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="UR controller", daemon=True)

    # --- life

    def start(self) -> None:
        """Start listening at an address whose ports are free.

        Raises
        ------
        MmtError
            No such address was found.
        """
        chance = random.SystemRandom()
        for _ in range(_TRIES):
            host = (
                f"127.{chance.randint(64, 127)}.{chance.randint(0, 255)}.{chance.randint(1, 254)}"
            )
            try:
                self._listen(host)
            except OSError:
                self._close_all()
                continue
            self.host = host
            self._thread.start()
            return
        raise MmtError("no loopback address has the ports of a UR controller free")

    def stop(self) -> None:
        """Stop, and free the ports."""
        self._ended.set()
        self._thread.join()
        self._close_all()
        self._selector.close()

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the robot's driver finds the arm and its surface."""
        place = {"origin_mm": list(_ORIGIN_MM), "rotation_rad": list(_ROTATION_RAD)}
        return {"host": self.host, **place}

    def unplug(self) -> None:
        """Close every connection and refuse new ones."""
        self._plugged = False
        while self._listeners:
            time.sleep(0.001)

    def plug(self) -> None:
        """Listen again at the same address, as after a restart: no program runs."""
        self.arm.end_program()
        self._plugged = True
        while not self._listeners:
            time.sleep(0.001)

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

    def drop(self, connection: PortConnection) -> None:
        """Forget a client."""
        if connection in self.connections:
            self.connections.remove(connection)
            self._selector.unregister(connection.link)
            connection.link.close()

    # --- its thread

    def _time_s(self, now_ns: int) -> float:
        return (now_ns - self._began_ns) / 1e9

    def _run(self) -> None:
        period_ns, due_ns, tick = 1_000_000_000 // RATE_HZ, time.monotonic_ns(), 0
        while not self._ended.is_set():
            due_ns = max(due_ns + period_ns, time.monotonic_ns() - 10 * period_ns)
            self._serve_until(due_ns)
            if self._plugged != bool(self._listeners):
                self._listen(self.host) if self._plugged else self._close_all()
            tick += 1
            now_ns = time.monotonic_ns()
            self.arm.step(self._time_s(now_ns), now_ns, period_ns / 1e9)
            if not self.silent:
                fields = self.arm.fields(self._time_s(now_ns))
                for connection in tuple(self.connections):
                    connection.send_state(fields, tick)

    def _serve_until(self, due_ns: int) -> None:
        """Serve the sockets until a time; `select` waits whole milliseconds, `sleep` the rest."""
        left_s = 1.0
        while left_s > 0.0:
            left_s = max(0, due_ns - time.monotonic_ns()) / 1e9 - 0.001
            if left_s <= 0.0:
                time.sleep(left_s + 0.001)
            for key, _ in self._selector.select(max(0.0, left_s)):
                act: Callable[[], None] = key.data
                act()

    def _listen(self, host: str) -> None:
        for port, kind in _PORTS.items():
            listener = socket.create_server((host, port))
            self._listeners.append(listener)
            self._selector.register(
                listener,
                selectors.EVENT_READ,
                lambda at=listener, kind=kind: self._accept(at, kind),
            )

    def _accept(self, listener: socket.socket, kind: type[PortConnection]) -> None:
        link, _ = listener.accept()
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = kind(self, link)
        self.connections.append(connection)
        self._selector.register(link, selectors.EVENT_READ, partial(self._receive, connection))
        connection.greet()

    def _receive(self, connection: PortConnection) -> None:
        try:
            data = connection.link.recv(_MOST_WAITING)
            connection.received += data
            if data:
                connection.handle_data()
        except (OSError, ValueError, struct.error, LookupError):
            data = b""
        if not data:
            self.drop(connection)

    def _close_all(self) -> None:
        for connection in tuple(self.connections):
            self.drop(connection)
        for listener in self._listeners:
            self._selector.unregister(listener)
            listener.close()
        self._listeners.clear()


def in_lab(world: "World", seed: int, _clockwork: "Clockwork") -> EmulatedUrController:
    """Return the arm of the virtual lab, in place of its robot."""
    world.take_robot()
    return EmulatedUrController(world, seed=seed)
