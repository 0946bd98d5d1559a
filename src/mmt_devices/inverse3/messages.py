"""The messages of the Haply Inverse Service: JSON texts over a WebSocket.

As Haply publishes it for the simulation channel of the service's versions 3.1 to 3.5
(docs.haply.co, Inverse SDK: "WebSocket Protocol", "Simulation Channel", "Control Commands",
"Basis Permutation"): on connection the service sends all devices, with their configuration; then
it answers each message with one that has the state of all devices. Metres, m/s and newtons.
Commands hold for one message; a device that gets none is idle.

The versions differ in the names of a command's numbers: ``vector`` of a force and ``position`` of
a place in 3.5, ``values`` of both in the published programs for 3.1.
"""

import json
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from mmt.devices.protocols import Vector

PROFILE: Final = "mmt"
"""How a session is named in the Haply Hub."""

_MM_PER_M: Final = 1000.0


class CommandNames(NamedTuple):
    """What the numbers of a command are called."""

    force: str
    position: str


NAMES: Final = {"3.1": CommandNames("values", "values"), "3.5": CommandNames("vector", "position")}


class OtherFormatError(Exception):
    """A message of the format 3.0, which an older port of the service has."""


def parse(text: str) -> dict[str, Any]:
    """Return the object that a text holds.

    Raises
    ------
    ValueError
        It holds none.
    """
    try:
        message = json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    if not isinstance(message, dict):
        raise ValueError("it is no object")  # noqa: TRY004 - of a text, not of a caller
    return message


def listed(message: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return the entries of a message's Inverse3 devices, by their identifier.

    Raises
    ------
    OtherFormatError
        The message lists them as version 3.0 did.
    """
    entries = message.get("inverse3")
    if isinstance(entries, dict):
        raise OtherFormatError
    if not isinstance(entries, list):
        return {}
    return {
        entry["device_id"]: entry
        for entry in entries
        if isinstance(entry, dict) and isinstance(entry.get("device_id"), str)
    }


def version_of(message: Mapping[str, Any], entry: Mapping[str, Any]) -> str:
    """Return whose names of commands the sender of the first message has, a key of `NAMES`.

    Version 3.5 numbers its sessions and tells a device's ``control_mode``, where those before it
    tell a ``mode``.
    """
    return "3.5" if "session_id" in message or "control_mode" in _part(entry, "state") else "3.1"


def read_place(entry: Mapping[str, Any]) -> tuple[Vector, Vector]:
    """Return a device's position (mm) and velocity (mm/s), which may be no finite numbers.

    Raises
    ------
    ValueError
        The entry lacks one of them.
    """
    state = _part(entry, "state")
    return _vector(state.get("cursor_position")), _vector(state.get("cursor_velocity"))


def read_flag(entry: Mapping[str, Any], name: str) -> bool | None:
    """Return a flag of a device's status, None where it is not told."""
    value = _part(entry, "status").get(name)
    return value if isinstance(value, bool) else None


def kind_of(entry: Mapping[str, Any]) -> str:
    """Return what a device says that it is, such as ``inverse3`` or ``minverse``."""
    kind = _part(entry, "config").get("type")
    return kind if isinstance(kind, str) and kind.isprintable() else "inverse3"


def force_command(device: str, names: CommandNames, force_n: Vector) -> str:
    """Return the message that displays a force."""
    return _command(device, "set_cursor_force", names.force, force_n)


def position_command(device: str, names: CommandNames, position_mm: Vector) -> str:
    """Return the message that has the service hold the tip at a place."""
    x, y, z = position_mm
    place_m = (x / _MM_PER_M, y / _MM_PER_M, z / _MM_PER_M)
    return _command(device, "set_cursor_position", names.position, place_m)


def greeting(device: str, names: CommandNames) -> str:
    """Return the first message: no force, and in 3.5 who is there."""
    message: dict[str, Any] = parse(force_command(device, names, (0.0, 0.0, 0.0)))
    if names is NAMES["3.5"]:
        message["session"] = {"configure": {"profile": {"name": PROFILE}}}
    return json.dumps(message)


def _command(device: str, command: str, name: str, numbers: Vector) -> str:
    x, y, z = numbers
    commands = {command: {name: {"x": x, "y": y, "z": z}}}
    return json.dumps({"inverse3": [{"device_id": device, "commands": commands}]})


def _part(entry: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part = entry.get(name)
    return part if isinstance(part, dict) else {}


def _vector(numbers: object) -> Vector:
    if not isinstance(numbers, dict):
        raise ValueError("three numbers are missing")  # noqa: TRY004 - of a text, not of a caller
    x, y, z = (numbers.get(axis) for axis in "xyz")
    if type(x) not in _NUMBERS or type(y) not in _NUMBERS or type(z) not in _NUMBERS:
        raise ValueError("one of three numbers is none")
    try:
        return (_MM_PER_M * x, _MM_PER_M * y, _MM_PER_M * z)  # type: ignore[operator]
    except OverflowError as error:  # an integer of hundreds of digits
        raise ValueError("a number is too large") from error


_NUMBERS: Final = (float, int)
