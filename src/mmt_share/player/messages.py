"""Messages of a page, parsed and validated: a page is not trusted."""

import json
from dataclasses import dataclass
from typing import Any, Final

from mmt.core.errors import InputError

MOST_STEPS: Final = 64
"""Most steps of a stroke in one message; a page sends some ten."""
LONGEST_STEP_MS: Final = 1000
_LARGEST_MM: Final = 10_000.0
_LARGEST_MM_S: Final = 10_000.0
_LARGEST_N: Final = 100.0
_LONGEST: Final = 40
"""Most characters of a line that a person writes."""


@dataclass(frozen=True)
class Step:
    """A short part of a stroke, which the page rendered with one velocity and force.

    Attributes
    ----------
    duration_ms
        Duration of the step.
    position_mm
        Position of the hand, x to the right and y upwards.
    velocity_mm_s
        Velocity along x and y.
    force_n
        Force along the surface's normal.
    """

    duration_ms: int
    position_mm: tuple[float, float]
    velocity_mm_s: tuple[float, float]
    force_n: float


def parse(text: str) -> dict[str, Any]:
    """Parse a message of a page, a JSON object with a string ``do``.

    Raises
    ------
    InputError
        The text is not such an object.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a message is a JSON object: {error}") from error
    if not isinstance(message, dict) or not isinstance(message.get("do"), str):
        raise InputError("a message is a JSON object with a word as `do`")
    return message


def steps_of(message: dict[str, Any]) -> tuple[Step, ...]:
    """Return the steps of a message about a stroke.

    Raises
    ------
    InputError
        A value is out of range or of another type, or there are too many steps.
    """
    steps = message.get("steps")
    if not isinstance(steps, list) or len(steps) > MOST_STEPS:
        raise InputError(f"steps is a list of {MOST_STEPS} at most")
    return tuple(_step(step) for step in steps)


def whole_number(message: dict[str, Any], name: str, largest: int, least: int = 0) -> int:
    """Return a whole number of a message.

    Raises
    ------
    InputError
        The value is not a whole number, or out of range.
    """
    value = message.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= largest:
        raise InputError(f"{name} is {value!r:.20}: allowed are {least} to {largest}")
    return value


def line(message: dict[str, Any], name: str) -> str:
    """Return a short line of text in a message, without spaces around it.

    Raises
    ------
    InputError
        The text is empty, too long, or not printable.
    """
    value = message.get(name)
    text = value.strip() if isinstance(value, str) else ""
    if not text or len(text) > _LONGEST or not text.isprintable():
        raise InputError(f"{name}: give a line of 1 to {_LONGEST} characters")
    return text


def _step(value: object) -> Step:
    if not isinstance(value, list) or len(value) != 6:
        raise InputError("a step is duration, x, y, velocity x, velocity y and force")
    x_mm, y_mm = (_finite(at, -_LARGEST_MM, _LARGEST_MM, "a position") for at in value[1:3])
    x_mm_s, y_mm_s = (_finite(v, -_LARGEST_MM_S, _LARGEST_MM_S, "a velocity") for v in value[3:5])
    return Step(
        int(_finite(value[0], 1.0, LONGEST_STEP_MS, "a step's duration")),
        (x_mm, y_mm),
        (x_mm_s, y_mm_s),
        _finite(value[5], 0.0, _LARGEST_N, "a force"),
    )


def _finite(value: object, least: float, largest: float, name: str) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not least <= value <= largest:  # type: ignore[operator]  # NaN is not
        raise InputError(f"{name} is {value!r:.20}: allowed are {least:g} to {largest:g}")
    return float(value)  # type: ignore[arg-type]  # it is a number
