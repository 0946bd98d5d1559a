"""Ask a controller's dashboard server whether the arm can be controlled, and explain why not.

Source: Universal Robots, "Dashboard Server e-Series, port 29999".
"""

import socket
from collections.abc import Sequence
from typing import Final

from mmt.core.errors import MmtError

PORT: Final = 29999
_PATIENCE_S: Final = 2.0

SAFETY: Final = {
    "PROTECTIVE_STOP": "is in a protective stop: the pendant shows why; free the tool, press "
    "Unlock (Enable Robot) there",
    "SAFEGUARD_STOP": "is stopped by a safeguard: leave the guarded area and reset the safeguard",
    "ROBOT_EMERGENCY_STOP": "is in an emergency stop: release the red button, then switch the arm "
    "on and release its brakes at the pendant",
    "SYSTEM_EMERGENCY_STOP": "is in an emergency stop of the system: reset it where it was "
    "pressed, then switch the arm on and release its brakes at the pendant",
    "VIOLATION": "has violated a safety limit: restart its safety system at the pendant",
    "FAULT": "has a safety fault: restart its safety system at the pendant",
    "RECOVERY": "is in recovery mode: move it within its limits at the pendant",
}
"""Safety status as named by a dashboard server -> state of the arm, and what to do."""
OFF: Final = "is not running (the pendant shows {}): switch it on and release its brakes there"
NOT_REMOTE: Final = (
    "is not in remote control: switch it from Local to Remote Control at the pendant (top right; "
    "Settings, System, Remote Control enables that)"
)


def problem(host: str) -> str:
    """Return why the arm at this host cannot be controlled now, empty if it can.

    The sentence has no subject. States that a controller's software does not report are ignored.

    Raises
    ------
    MmtError
        No dashboard server answers.
    """
    mode, safety, remote = _ask(host, ("robotmode", "safetystatus", "is in remote control"))
    safety, mode = (each.rpartition(": ")[2] for each in (safety, mode))
    for name, sentence in SAFETY.items():
        if name in safety:  # also in AUTOMATIC_MODE_SAFEGUARD_STOP
            return sentence
    if mode in {"NO_CONTROLLER", "DISCONNECTED", "POWER_OFF", "POWER_ON", "BOOTING", "IDLE"}:
        return OFF.format(mode)
    return NOT_REMOTE if remote == "false" else ""


def _ask(host: str, questions: Sequence[str]) -> list[str]:
    try:
        with (
            socket.create_connection((host, PORT), _PATIENCE_S) as link,
            link.makefile("rw", encoding="ascii", errors="replace", newline="\n") as lines,
        ):
            _line(lines.readline())  # the greeting
            answers = []
            for question in questions:
                lines.write(question + "\n")
                lines.flush()
                answers.append(_line(lines.readline()))
            return answers
    except OSError as error:
        raise MmtError(
            f"no UR controller answers at {host} ({error}): check 'host', that its cable is in, "
            "and that it is switched on"
        ) from error


def _line(text: str) -> str:
    if not text:
        raise ConnectionResetError("it closed the connection")
    return text.strip()
