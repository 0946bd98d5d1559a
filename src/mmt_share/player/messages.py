"""Messages of a page, parsed and validated: a page is not trusted."""

from typing import Annotated, Any, Final, NamedTuple

from annotated_types import Ge, Le, MaxLen

from mmt.core.errors import InputError
from mmt.core.files.untrusted import json_object
from mmt_share.messages import parsed

MOST_STEPS: Final = 64
"""Most steps of a stroke in one message; a page sends some ten."""
LONGEST_STEP_MS: Final = 1000
_LONGEST: Final = 40
"""Most characters of a line that a person writes."""


_Motion = Annotated[float, Ge(-10_000), Le(10_000)]


class Step(NamedTuple):
    """A short part of a stroke, which the page rendered with one velocity and force.

    Attributes
    ----------
    duration_ms
        Duration of the step.
    x_mm, y_mm
        Position of the hand, x to the right and y upwards.
    x_mm_s, y_mm_s
        Velocity along x and y.
    force_n
        Force along the surface's normal.
    """

    duration_ms: Annotated[int, Ge(1), Le(LONGEST_STEP_MS)]
    x_mm: _Motion
    y_mm: _Motion
    x_mm_s: _Motion
    y_mm_s: _Motion
    force_n: Annotated[float, Ge(0), Le(100)]


def parse(text: str) -> dict[str, Any]:
    """Parse a message of a page, a JSON object with a string ``do``.

    Raises
    ------
    InputError
        The text is not such an object.
    """
    message = json_object(text, "a message")
    if not isinstance(message.get("do"), str):
        raise InputError("a message is a JSON object with a word as `do`")
    return message


def steps_of(message: dict[str, Any]) -> list[Step]:
    """Return the steps of a message about a stroke.

    Raises
    ------
    InputError
        A value is out of range or of another type, or there are too many steps.
    """
    kind = Annotated[list[Step], MaxLen(MOST_STEPS)]
    steps: list[Step] = parsed(kind, message.get("steps"), "a stroke", strict=True)
    return steps


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
