"""Ports of an emulated controller: connections of clients, and the packages of RTDE.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) guide". Numbers are big-endian.
"""

import asyncio
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, Protocol

HEADER: Final = struct.Struct(">HB")
"""Size of the whole package, and its kind."""

PROTOCOL_VERSION: Final = ord("V")
CONTROL_VERSION: Final = ord("v")
OUTPUTS: Final = ord("O")
INPUTS: Final = ord("I")
START: Final = ord("S")
PAUSE: Final = ord("P")
DATA: Final = ord("U")

_FORMATS: Final = {
    "DOUBLE": "d",
    "INT32": "i",
    "UINT32": "I",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
}
_TYPES: Final = {
    "timestamp": "DOUBLE",
    "actual_TCP_pose": "VECTOR6D",
    "actual_TCP_force": "VECTOR6D",
    "robot_mode": "INT32",
    "safety_mode": "INT32",
    "runtime_state": "UINT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    "external_force_torque": "VECTOR6D",
}
_REGISTER: Final = re.compile(r"(?:in|out)put_(int|double)_register_\d+")


def pack(kind: int, body: bytes = b"") -> bytes:
    """Return a package."""
    return HEADER.pack(HEADER.size + len(body), kind) + body


def packages(received: bytearray) -> Iterator[tuple[int, bytes]]:
    """Remove the complete packages from the received bytes; yield kind and body of each."""
    while len(received) >= HEADER.size:
        size, kind = HEADER.unpack_from(received)
        if size < HEADER.size:
            raise ValueError(f"a package of {size} bytes")
        if len(received) < size:
            return
        body = bytes(received[HEADER.size : size])
        del received[:size]
        yield kind, body


def type_of(name: str) -> str:
    """Return the type of a field, ``NOT_FOUND`` if this controller has none of that name."""
    register = _REGISTER.fullmatch(name)
    if register is not None:
        return "INT32" if register[1] == "int" else "DOUBLE"
    return _TYPES.get(name, "NOT_FOUND")


class Recipe:
    """The fields of a data package, in their order.

    Parameters
    ----------
    names
        Names of the fields, joined by commas as a client sends them.
    """

    def __init__(self, names: bytes) -> None:
        self.names = [name for name in names.decode("ascii", "replace").split(",") if name]
        self.types = [type_of(name) for name in self.names]
        formats = [_FORMATS.get(each, "") for each in self.types]
        self._layout = struct.Struct(">" + "".join(formats))
        self._counts = [int(each[:-1] or 1) if each else 0 for each in formats]

    @property
    def known(self) -> bool:
        """Whether the controller has all of the fields."""
        return "NOT_FOUND" not in self.types

    def answer(self, number: int) -> bytes:
        """Return the body that tells a client the recipe's number and types."""
        return bytes((number if self.known else 0,)) + ",".join(self.types).encode()

    def pack(self, values: Mapping[str, Any]) -> bytes:
        """Return the body of a package with the fields' values from a mapping."""
        flat: list[Any] = []
        for name in self.names:
            value = values[name]
            flat.extend(value if isinstance(value, Sequence) else (value,))
        return self._layout.pack(*flat)

    def unpack(self, body: bytes) -> dict[str, Any]:
        """Return the fields of a package by their names."""
        flat = iter(self._layout.unpack(body))
        values: dict[str, Any] = {}
        for name, count in zip(self.names, self._counts, strict=True):
            taken = tuple(next(flat) for _ in range(count))
            values[name] = taken[0] if count == 1 else taken
        return values


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
        for kind, body in packages(self.received):
            if kind == DATA:
                recipe = self._inputs[body[0] - 1]
                self.controller.set_registers(recipe.unpack(body[1:]))
            else:
                self.send(pack(kind, self._answer(kind, body)))

    def _answer(self, kind: int, body: bytes) -> bytes:
        if kind == PROTOCOL_VERSION:
            accepted = body == b"\x00\x02" and not self.controller.refuses_version
            self._with_frequency = accepted
            return bytes((accepted,))
        if kind == CONTROL_VERSION:
            return struct.pack(">4I", *VERSION)
        if kind == OUTPUTS:
            return self._set_up_outputs(body)
        if kind == INPUTS:
            self._inputs.append(Recipe(body))
            return self._inputs[-1].answer(len(self._inputs))
        if kind == START:
            self._started = self._outputs is not None and self._outputs.known
            return bytes((self._started,))
        if kind == PAUSE:
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
            self.send(pack(DATA, b"\x01" + self._outputs.pack(fields)))
