"""Messages of a page, parsed and validated: a page is not trusted."""

import json
from dataclasses import dataclass
from typing import Any, Final

from mmt.core.errors import InputError
from mmt_share.player.motion import Point

MOST_POINTS: Final = 256
"""Most reports of a pointer in one request: a second at the fastest screens."""
LARGEST_MM: Final = 10_000.0
LARGEST_N: Final = 100.0
_LARGEST_MS: Final = 1e12
_LARGEST_COUNT: Final = 2**50


@dataclass(frozen=True)
class PlayRequest:
    """A page asks for samples.

    Attributes
    ----------
    number
        Number of the request.
    now_ms
        Time by the page's clock (ms).
    played
        Samples that it has played since the stream began.
    lead
        Samples that it wants to have beyond these.
    tile
        Tile under the pointer, None where it is on no tile or up.
    points
        Reports of the pointer since the last request.
    """

    number: int
    now_ms: float
    played: int
    lead: int
    tile: int | None
    points: tuple[Point, ...]


def parse(text: str) -> dict[str, Any]:
    """Return a message of a page, a JSON object with ``do``.

    Raises
    ------
    InputError
        It is not such an object.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"a message is a JSON object: {error}") from error
    if not isinstance(message, dict) or not isinstance(message.get("do"), str):
        raise InputError("a message is a JSON object with a word as `do`")
    return message


def play_request(message: dict[str, Any], tiles: int) -> PlayRequest:
    """Return the request of a message, for a grid with this number of tiles.

    Raises
    ------
    InputError
        Something in it is out of its range, or of another type.
    """
    tile = message.get("tile")
    if tile is not None:
        tile = whole(message, "tile", tiles - 1)
    points = message.get("points")
    if not isinstance(points, list) or len(points) > MOST_POINTS:
        raise InputError(f"points is a list of {MOST_POINTS} at most")
    return PlayRequest(
        number=whole(message, "number", _LARGEST_COUNT),
        now_ms=_finite(message.get("now_ms"), 0.0, _LARGEST_MS, "now_ms"),
        played=whole(message, "played", _LARGEST_COUNT),
        lead=whole(message, "lead", _LARGEST_COUNT),
        tile=tile,
        points=tuple(_point(point) for point in points),
    )


def whole(message: dict[str, Any], name: str, largest: int, least: int = 0) -> int:
    """Return a whole number of a message.

    Raises
    ------
    InputError
        It is not a whole number, or out of range.
    """
    value = message.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= largest:
        raise InputError(f"{name} is {value!r:.20}: allowed are {least} to {largest}")
    return value


def line(message: dict[str, Any], name: str, longest: int = 40) -> str:
    """Return a short line of text in a message, without spaces around it.

    Raises
    ------
    InputError
        It is empty, too long, or not printable.
    """
    value = message.get(name)
    text = value.strip() if isinstance(value, str) else ""
    if not text or len(text) > longest or not text.isprintable():
        raise InputError(f"{name}: give a line of 1 to {longest} characters")
    return text


def _point(value: object) -> Point:
    if not isinstance(value, list) or len(value) != 4:
        raise InputError("a point is time, x, y and force")
    return (
        _finite(value[0], 0.0, _LARGEST_MS, "a point's time"),
        _finite(value[1], -LARGEST_MM, LARGEST_MM, "a point's x"),
        _finite(value[2], -LARGEST_MM, LARGEST_MM, "a point's y"),
        _finite(value[3], 0.0, LARGEST_N, "a point's force"),
    )


def _finite(value: object, least: float, largest: float, name: str) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not least <= value <= largest:  # type: ignore[operator]  # NaN is not
        raise InputError(f"{name} is {value!r:.20}: allowed are {least:g} to {largest:g}")
    return float(value)  # type: ignore[arg-type]  # it is a number
