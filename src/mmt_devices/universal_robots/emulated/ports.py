"""Connections of clients to the ports of an emulated controller."""

import asyncio
import struct
from typing import Any, Final, Protocol

from mmt_devices.universal_robots.emulated import rtde
from mmt_devices.universal_robots.emulated.rtde import Recipe

VERSION: Final = (5, 12, 2, 1101319)
"""Version of the emulated software."""
RATE_HZ: Final = 500


class Controller(Protocol):
    """The controller behind the ports."""

    refuses_version: bool
    """Whether the controller speaks only the first version of RTDE."""
    connections: "list[PortConnection]"

    def answer(self, line: str) -> str:
        """Return the dashboard server's answer to a line."""

    def run_script(self) -> None:
        """Run the control script."""

    def set_registers(self, values: dict[str, Any]) -> None:
        """Take input registers."""


class PortConnection(asyncio.Protocol):
    """One client at one port.

    Parameters
    ----------
    controller
        Whose port it is.
    """

    transport: asyncio.Transport

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.received = bytearray()

    def connection_made(self, transport: Any) -> None:
        """Note the client, and greet it."""
        self.transport = transport
        self.controller.connections.append(self)
        self.greet()

    def data_received(self, data: bytes) -> None:
        """Handle data; a client that sends what makes no sense is dropped."""
        self.received += data
        try:
            self.handle_data()
        except (ValueError, struct.error, LookupError):
            self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - whatever ended it
        """Forget the client."""
        self.controller.connections.remove(self)

    def send(self, data: bytes) -> None:
        """Send data; a client that does not read is dropped, as by a real controller."""
        self.transport.write(data)
        if self.transport.get_write_buffer_size():
            self.transport.abort()

    def greet(self) -> None:
        """Send the greeting of the port; none by default."""

    def handle_data(self) -> None:
        """Handle the received data; by default, leave it."""

    def send_state(self, fields: dict[str, Any], tick: int) -> None:
        """Send the data of a cycle; none by default."""


class DashboardConnection(PortConnection):
    """Receives lines of text, and answers each by a line."""

    def greet(self) -> None:
        """Send the greeting of the dashboard server."""
        self.send(b"Connected: Universal Robots Dashboard Server\n")

    def handle_data(self) -> None:
        """Answer each line."""
        while b"\n" in self.received:
            line, _, rest = self.received.partition(b"\n")
            self.received[:] = rest
            self.send((self.controller.answer(line.decode("ascii", "replace")) + "\n").encode())


class ScriptConnection(PortConnection):
    """Receives scripts, and answers nothing."""

    def handle_data(self) -> None:
        """Start ur_rtde's control script once it is complete, down to its last ``end``."""
        if self.received.startswith(b"def rtde_control():") and self.received.endswith(b"\nend\n"):
            self.received.clear()
            self.controller.run_script()


class RtdeConnection(PortConnection):
    """A session of RTDE."""

    def __init__(self, controller: Controller) -> None:
        super().__init__(controller)
        self._outputs: Recipe | None = None
        self._inputs: list[Recipe] = []
        self._every = 1
        self._with_frequency = False
        self._started = False

    def handle_data(self) -> None:
        """Answer each package."""
        for kind, body in rtde.packages(self.received):
            if kind == rtde.DATA:
                recipe = self._inputs[body[0] - 1]
                self.controller.set_registers(recipe.unpack(body[1:]))
            else:
                self.send(rtde.pack(kind, self._answer(kind, body)))

    def _answer(self, kind: int, body: bytes) -> bytes:
        if kind == rtde.PROTOCOL_VERSION:
            accepted = body == b"\x00\x02" and not self.controller.refuses_version
            self._with_frequency = accepted
            return bytes((accepted,))
        if kind == rtde.CONTROL_VERSION:
            return struct.pack(">4I", *VERSION)
        if kind == rtde.OUTPUTS:
            return self._set_up_outputs(body)
        if kind == rtde.INPUTS:
            self._inputs.append(Recipe(body))
            return self._inputs[-1].answer(len(self._inputs))
        if kind == rtde.START:
            self._started = self._outputs is not None and self._outputs.known
            return bytes((self._started,))
        if kind == rtde.PAUSE:
            self._started = False
            return b"\x01"
        raise ValueError(f"a package of kind {kind}")

    def _set_up_outputs(self, body: bytes) -> bytes:
        """Read the names of the fields and, not in the first version, the rate before them."""
        if self._with_frequency:
            (rate_hz,) = struct.unpack_from(">d", body)
            self._every = max(1, round(RATE_HZ / rate_hz))
            body = body[8:]
        self._outputs = Recipe(body)
        return self._outputs.answer(1)

    def send_state(self, fields: dict[str, Any], tick: int) -> None:
        """Send a data package if one is due."""
        if self._started and self._outputs is not None and tick % self._every == 0:
            self.send(rtde.pack(rtde.DATA, b"\x01" + self._outputs.pack(fields)))
