"""The packages of RTDE, protocol 2, as a controller reads and writes them.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) guide". Numbers are big-endian.
"""

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

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
