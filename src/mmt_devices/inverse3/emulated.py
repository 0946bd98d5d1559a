"""Emulated Haply Inverse Services with their devices, and the process that runs them.

It serves the messages described in `mmt_devices.inverse3.messages`, after Haply's published pages.
Commands with the names of another version are ignored.

For the handle, a simulated hand holds the tip and strokes a surface at the scene's zero. For the
robot, the tip is free. See `mmt.testing.emulated.lab_process`.
"""

import asyncio
import json
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any, Final, Literal

from aiohttp import WSMsgType, web

from mmt.core.arrays import Vector
from mmt.scene import Hand
from mmt.testing.emulated.lab_process import run_lab
from mmt.testing.simulation import START_MM
from mmt.testing.simulation.hand import SimulatedHand
from mmt_devices.inverse3.emulated_tip import EmulatedTip, HeldAt

REST_MM: Final[Vector] = (0.0, -150.0, 150.0)
"""About the middle of an Inverse3's space."""

Version = Literal["3.0", "3.4", "3.5"]
Fault = Literal[
    "mute", "silent", "nonsense", "numberless", "nan", "far", "absent", "uncalibrated", "unpowered"
]
"""``mute``: no first message; ``silent``: no answers; ``numberless``: answers without positions;
``nonsense``: text that is no JSON; ``far``: out of reach; other names say what goes wrong."""

_NAMES: Final = {"3.0": ("values", "values"), "3.4": ("values", "values"),
                 "3.5": ("vector", "position")}  # fmt: skip
_CLOSE_S: Final = 0.2
_SHUTDOWN_S: Final = 0.5


class EmulatedInverse3:
    """The service on a port of this machine, in a thread of its own.

    Parameters
    ----------
    tips
        Tips of the devices by identifier; None for one device ``049D`` with a free tip.
    """

    def __init__(self, tips: Mapping[str, EmulatedTip] | None = None) -> None:
        self.tips = {"049D": EmulatedTip(REST_MM)} if tips is None else dict(tips)
        self.version: Version = "3.5"
        """Version of the message format."""
        self.port = 0
        """TCP port; a free one is taken at the first start, and kept."""
        self.heard = 0
        """Number of messages received."""
        self.profile: str | None = None
        """Name that the client gave its session, or None."""
        self._faults: set[Fault] = set()
        self._lock = threading.Lock()
        self._open: set[web.WebSocketResponse] = set()
        self._ready = threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ended: asyncio.Event | None = None
        self._thread: threading.Thread | None = None

    @property
    def tip(self) -> EmulatedTip:
        """Tip of the first device; `tip_state` advances it to the present."""
        return next(iter(self.tips.values()))

    @property
    def options(self) -> dict[str, Any]:
        """Options by which the driver finds the service."""
        return {"address": f"ws://127.0.0.1:{self.port}"}

    def start(self) -> None:
        """Start listening."""
        self._ready.clear()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve()), name="emulated Inverse3", daemon=True
        )
        self._thread.start()
        self._ready.wait()

    def stop(self) -> None:
        """Stop, and free the port; calling it twice is harmless."""
        if self._thread is not None and self._loop is not None and self._ended is not None:
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join()
            self._thread = None

    def tip_state(self) -> EmulatedTip:
        """Return the first tip as it is now."""
        with self._lock:
            self.tip.advance(time.monotonic_ns())
            return self.tip

    # --- faults

    def fail(self, fault: Fault, *, on: bool = True) -> None:
        """Start a fault, or end it."""
        (self._faults.add if on else self._faults.discard)(fault)

    def unplug(self) -> None:
        """Take the devices away from the service."""
        self.fail("absent")

    def plug(self) -> None:
        """Give the devices back to the service."""
        self.fail("absent", on=False)

    def stall(self, *, silent: bool = True) -> None:
        """Stop answering, or answer again."""
        self.fail("silent", on=silent)

    def drop(self) -> None:
        """Close all connections."""
        if self._loop is not None:
            for socket in list(self._open):
                asyncio.run_coroutine_threadsafe(_close(socket), self._loop)

    # --- the service

    async def _serve(self) -> None:
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        application = web.Application()
        application.router.add_get("/", self._talk)
        runner = web.AppRunner(application, access_log=None, shutdown_timeout=_SHUTDOWN_S)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", self.port).start()
        self.port = runner.addresses[0][1]
        self._ready.set()
        await self._ended.wait()
        for socket in list(self._open):
            await _close(socket)
        await runner.cleanup()

    async def _talk(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(timeout=_CLOSE_S)
        await socket.prepare(request)
        try:
            if "mute" not in self._faults:
                await self._say(socket, first=True)
            self._open.add(socket)
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    self.heard += 1
                    self._obey(json.loads(message.data))
                    await self._say(socket)
        except ConnectionError:
            pass  # the client has left
        finally:
            self._open.discard(socket)
        return socket

    async def _say(self, socket: web.WebSocketResponse, *, first: bool = False) -> None:
        if "nonsense" in self._faults:
            await socket.send_str("<html>")
        elif "silent" not in self._faults or first:
            await socket.send_str(json.dumps(self._message(first=first)))

    def _obey(self, message: dict[str, Any]) -> None:
        named = message.get("session", {}).get("configure", {}).get("profile", {}).get("name")
        self.profile = named or self.profile
        of_force, of_position = _NAMES[self.version]
        now_ns = time.monotonic_ns()
        for entry in message.get("inverse3", []):
            tip, commands = self.tips.get(entry["device_id"]), entry.get("commands", {})
            force = commands.get("set_cursor_force", {}).get(of_force)
            place = commands.get("set_cursor_position", {}).get(of_position)
            if tip is None:
                continue
            with self._lock:
                if place is not None:
                    tip.command_position(_from_metres(place), now_ns)
                elif force is not None:
                    tip.command_force((force["x"], force["y"], force["z"]), now_ns)

    def _message(self, *, first: bool) -> dict[str, Any]:
        entries = []
        if "absent" not in self._faults:
            entries = [self._entry(name, tip, first=first) for name, tip in self.tips.items()]
        if self.version == "3.0":
            return {"inverse3": {entry.pop("device_id"): entry for entry in entries}}
        message: dict[str, Any] = {"inverse3": entries, "wireless_verse_grip": []}
        return {"session_id": 7, **message} if self.version == "3.5" and first else message

    def _entry(self, name: str, tip: EmulatedTip, *, first: bool) -> dict[str, Any]:
        with self._lock:
            tip.advance(time.monotonic_ns())
            entry = {"device_id": name, "state": self._state(tip)}
        entry["status"] = {
            "calibrated": "uncalibrated" not in self._faults,
            "in_use": len(self._open) > 0,
            "power_supply": "unpowered" not in self._faults,
            "ready": True,
            "started": True,
        }
        if first:
            entry["config"] = {
                "type": "inverse3",
                "device_info": {"major_version": 7, "minor_version": 4, "id": name},
                "handedness": "right",
                "gravity_compensation": {"enabled": True, "scaling_factor": 1.0},
                "torque_scaling": {"enabled": True},
            }
        return entry

    def _state(self, tip: EmulatedTip) -> dict[str, Any]:
        zero, angles = _three((0.0, 0.0, 0.0)), {"a0": 0.0, "a1": 0.0, "a2": 0.0}
        position_mm = tip.position_mm
        if "nan" in self._faults:
            position_mm = (float("nan"), 0.0, 0.0)
        elif "far" in self._faults:
            position_mm = (1e4, 0.0, 0.0)
        state: dict[str, Any] = {
            "cursor_position": _metres(position_mm),
            "cursor_velocity": _metres(tip.velocity_mm_s),
            "angular_position": angles,
            "angular_velocity": angles,
            "body_orientation": {"w": 1.0, **zero},
        }
        if "numberless" in self._faults:
            del state["cursor_position"]
        if self.version == "3.5":
            force = _three(tip.motor_n)
            return {**state, "current_cursor_force": force, "control_domain": "cartesian",
                    "control_mode": tip.mode}  # fmt: skip
        return {**state, "mode": tip.mode}


async def _close(socket: web.WebSocketResponse) -> None:
    await socket.close(code=1001)


def _three(numbers: Vector) -> dict[str, float]:
    return dict(zip("xyz", numbers, strict=True))


def _metres(place_mm: Vector) -> dict[str, float]:
    x, y, z = place_mm
    return _three((x / 1e3, y / 1e3, z / 1e3))


def _from_metres(place: Mapping[str, float]) -> Vector:
    return (1e3 * place["x"], 1e3 * place["y"], 1e3 * place["z"])


def stroking_hand(seed: int) -> HeldAt:
    """Return a simulated hand that holds the tip and feels the displayed force."""
    hand = SimulatedHand(Hand(), seed)

    def held_at(felt_n: Vector) -> Vector:
        hand.write(felt_n)
        return _on_device(hand.read(1).position_mm)

    return held_at


def _on_device(position_mm: Vector) -> Vector:
    """Convert a scene's position (mm) to the device's axes, by the driver's default options."""
    (x, y, z), (u, v, w) = position_mm, REST_MM
    return (x + u, y + v, z + w)


def main(seed: int) -> None:
    """Run the services until standard input ends."""

    def service(role: str) -> EmulatedInverse3:
        held = stroking_hand(seed) if role == "handle" else None
        return EmulatedInverse3({"049D": EmulatedTip(_on_device(START_MM), held)})

    run_lab(service)


if __name__ == "__main__":
    main(int(sys.argv[1]))
