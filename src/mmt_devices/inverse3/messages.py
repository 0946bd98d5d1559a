"""Messages of the Haply Inverse Service: JSON texts over a WebSocket.

On connection the service sends all devices with their configuration. Then it answers each message
with the state of all devices, in metres, m/s and newtons. A command holds for one message; a device
without a command is idle. The versions name a command's numbers differently: ``vector`` for a force
and ``position`` for a position in 3.5, ``values`` for both in the published programs for 3.1.

Source: docs.haply.co, Inverse SDK: "WebSocket Protocol", "Simulation Channel", "Control Commands",
"Basis Permutation", for the simulation channel of the service's versions 3.1 to 3.5.
"""

import json
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from mmt.core.arrays import Vector

PROFILE: Final = "mmt"
"""Name of our sessions in the Haply Hub."""

_MM_PER_M: Final = 1000.0


class CommandNames(NamedTuple):
    """Keys of the numbers in a command of force and in one of position."""

    force: str
    position: str


NAMES: Final = {"3.1": CommandNames("values", "values"), "3.5": CommandNames("vector", "position")}


class OtherFormatError(Exception):
    """The message has the format 3.0, which the service uses on an older port."""


def parse(text: str) -> dict[str, Any]:
    """Return the JSON object that a text holds.

    Raises
    ------
    ValueError
        The text holds no JSON object.
    """
    try:
        message = json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    if not isinstance(message, dict):
        raise ValueError("it is no object")  # noqa: TRY004 - bad text, no bad type
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
    """Return the key of `NAMES` for the service that has sent this first message.

    Version 3.5 sends a ``session_id``, and a device's ``control_mode``; earlier versions have
    ``mode`` instead.
    """
    return "3.5" if "session_id" in message or "control_mode" in _part(entry, "state") else "3.1"


def read_place(entry: Mapping[str, Any]) -> tuple[Vector, Vector]:
    """Return a device's position (mm) and velocity (mm/s), not always finite.

    Raises
    ------
    ValueError
        One of the numbers is missing, no number, or too large.
    """
    state = _part(entry, "state")
    return _vector(state.get("cursor_position")), _vector(state.get("cursor_velocity"))


def read_flag(entry: Mapping[str, Any], name: str) -> bool | None:
    """Return a flag of a device's status, or None if the entry lacks it."""
    value = _part(entry, "status").get(name)
    return value if isinstance(value, bool) else None


def kind_of(entry: Mapping[str, Any]) -> str:
    """Return the type that a device reports, such as ``minverse``; if none, ``inverse3``."""
    kind = _part(entry, "config").get("type")
    return kind if isinstance(kind, str) and kind.isprintable() else "inverse3"


def force_command(device: str, names: CommandNames, force_n: Vector) -> str:
    """Return the message that displays a force (N)."""
    return _command(device, "set_cursor_force", names.force, force_n)


def position_command(device: str, names: CommandNames, position_mm: Vector) -> str:
    """Return the message that makes the service hold the tip at a position (mm)."""
    x, y, z = position_mm
    place_m = (x / _MM_PER_M, y / _MM_PER_M, z / _MM_PER_M)
    return _command(device, "set_cursor_position", names.position, place_m)


def greeting(device: str, names: CommandNames) -> str:
    """Return the first message: zero force, and in 3.5 our session's name."""
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
        raise ValueError("three numbers are missing")  # noqa: TRY004 - bad text, no bad type
    x, y, z = (numbers.get(axis) for axis in "xyz")
    if type(x) not in _NUMBERS or type(y) not in _NUMBERS or type(z) not in _NUMBERS:
        raise ValueError("one of three numbers is none")
    try:
        return (_MM_PER_M * x, _MM_PER_M * y, _MM_PER_M * z)  # type: ignore[operator]
    except OverflowError as error:  # an integer of hundreds of digits
        raise ValueError("a number is too large") from error


_NUMBERS: Final = (float, int)
