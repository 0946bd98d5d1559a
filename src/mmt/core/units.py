"""Units of length, force, acceleration, time and speed as people write them.

Spellings are compared as they stand, then in lower case, where milli takes precedence over mega.
An unknown unit has no factor; the caller must refuse it by name.
"""

import re
import unicodedata
from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from typing import Final

QUANTITIES: Final[Mapping[str, str]] = {
    "time": "s, ms, us, ns, min, h, d",
    "position": "mm, m, cm, um, nm, in, ft",
    "force": "N, mN, cN, kN, gf, kgf (kg), lbf (lb), ozf, dyn",
    "acceleration": "m/s2, mm/s2, cm/s2, g, mg, ft/s2, in/s2, Gal",
    "speed": "mm/s, m/s, cm/s, in/s",
}
"""Examples of units of each quantity, for messages; the first is the unit in frames."""

DATE: Final = "date"
"""Unit of times read from dates or times of day: seconds, whatever unit the user names."""
GRAVITY_M_S2: Final = 9.80665
"""Standard gravity."""
_POUND_N: Final = 0.45359237 * GRAVITY_M_S2
_PREFIXES: Final = {"": 1.0, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "k": 1e3}
_LONG_PREFIXES: Final = {"": "", "nano": "n", "micro": "u", "milli": "m", "centi": "c", "kilo": "k"}
_METRIC: Final = {
    "time": {"s": 1.0, "sec": 1.0, "secs": 1.0},
    "position": {"m": 1e3},
    "force": {"N": 1.0, "gf": GRAVITY_M_S2 / 1e3, "g": GRAVITY_M_S2 / 1e3, "dyn": 1e-5},
    "acceleration": {"g": GRAVITY_M_S2, "gn": GRAVITY_M_S2, "Gal": 0.01},
}
"""Symbols that take a prefix. A mass as a force is its weight."""
_WORDS: Final = {
    "time": {"second": 1.0, "sec": 1.0},
    "position": {"meter": 1e3, "metre": 1e3},
    "force": {"newton": 1.0, "gram": GRAVITY_M_S2 / 1e3, "dyne": 1e-5},
}
"""Words that take a prefix in full, and a plural."""
_OTHERS: Final = {
    "time": {
        DATE: 1.0,
        "100ns": 1e-7,  # the ticks of .NET and of Windows
        **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
        **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
        **dict.fromkeys(("d", "day", "days"), 86400.0),
    },
    "position": {
        **dict.fromkeys(("in", "inch", "inches", '"'), 25.4),
        **dict.fromkeys(("ft", "foot", "feet"), 304.8),
        **dict.fromkeys(("mil", "mils", "thou"), 0.0254),
        **dict.fromkeys(("micron", "microns"), 1e-3),
    },
    "force": {
        **dict.fromkeys(("lbf", "lb", "lbs", "pound", "pounds"), _POUND_N),
        **dict.fromkeys(("klbf", "klb"), 1e3 * _POUND_N),
        **dict.fromkeys(("ozf", "oz", "ounce", "ounces"), _POUND_N / 16),
        **dict.fromkeys(("kp", "kilopond"), GRAVITY_M_S2),
        "MN": 1e6,
    },
    "acceleration": {"g0": GRAVITY_M_S2, "g_n": GRAVITY_M_S2, "gee": GRAVITY_M_S2},
}
_RATE: Final = re.compile(r"(?P<length>.+?)(?P<per>[/_]?)(?P<time>s|sec|min|h)(?P<power>-?[12])?")
"""A length per time, once or twice."""
_FOREIGN: Final = re.compile(
    r"m?v|volts?|counts?|cnts?|lsb|adc|deg|degrees?|m?rad|[kmhn]?pa|percent|[kmn]?n[_.-]?m?m"
)
"""Endings of names that are units of other quantities."""
_LONGEST: Final = 100
"""Most characters of a unit: patterns take a time that is quadratic in them."""


def unit_factor(quantity: str, text: str) -> float | None:
    """Return the factor to the unit in frames, or None if the unit is not known."""
    plain = _plain(text)
    factor = _exact(quantity, plain)
    if factor is not None or plain.endswith("Nm"):  # a torque is no nanometre
        return factor
    return _exact(quantity, plain.lower())


@lru_cache(maxsize=64)
def is_unit(text: str) -> bool:
    """Return whether a text is a unit of any quantity."""
    foreign = _FOREIGN.fullmatch(_plain(text).lower()) is not None
    return foreign or any(unit_factor(quantity, text) is not None for quantity in QUANTITIES)


def unit_in_name(quantity: str, name: str) -> str:
    """Return the unit in brackets or at the end of a name, perhaps of another quantity, or ""."""
    name = name[-2 * _LONGEST :]
    for inside in re.findall(r"[\[(]([^\])]+)[\])]", name):
        if unit_factor(quantity, inside) is not None:
            return str(inside)
    spaced = re.sub(r"([a-z])([A-Z][a-z])", r"\1_\2", name)
    words = [word for word in re.split(r"[\s_.,/:-]+", spaced) if word]
    for count in (2, 1):
        unit = "_".join(words[-count:])
        known = len(words) > count and unit_factor(quantity, unit) is not None
        # a single letter is mostly part of the name: t_d, F_h
        if known and (len(unit) > 1 or unit in "smgnN"):
            return unit
    last = words[-1] if len(words) > 1 else ""
    # v is a velocity, V is volts
    return last if last != "v" and _FOREIGN.fullmatch(_plain(last).lower()) else ""


def _plain(text: str) -> str:
    """Return a unit in ASCII: micro as u, powers as figures, no blanks, dots or brackets."""
    if len(text) > _LONGEST:
        return ""
    text = unicodedata.normalize("NFKC", text)
    for sign, plain in (("μ", "u"), ("\N{MINUS SIGN}", "-"), ("\N{PRIME}" * 2, '"')):
        text = text.replace(sign, plain)
    text = re.sub(r"\s+since\b.*", "", text)  # times in netCDF
    text = re.sub(r"\s*\bper\b\s*", "/", text)
    return re.sub(r"[\s·⋅*^()\[\]{}<>]|\.\s*$", "", text)


def _exact(quantity: str, unit: str) -> float | None:
    found = _table(quantity).get(unit)
    if found is not None or quantity not in ("acceleration", "speed"):
        return found
    squared = quantity == "acceleration"
    if squared:
        unit = re.sub(r"/(s|sec)/\1$", r"/\g<1>2", unit)
    match = _RATE.fullmatch(unit)
    if match is None:
        return None
    power = (match["power"] or "1").lstrip("-")
    told = bool(match["per"] or match["power"])
    length, time_s = _exact("position", match["length"]), _exact("time", match["time"])
    if length is None or time_s is None or power != ("2" if squared else "1") or not told:
        return None
    return length / 1e3 / time_s**2 if squared else length / time_s


@cache
def _table(quantity: str) -> Mapping[str, float]:
    """Return the factors by spelling; one in lower case means the first unit that matches."""
    table: dict[str, float] = {}
    for spelling, factor in _spellings(quantity):
        table.setdefault(spelling, factor)
    for spelling, factor in tuple(table.items()):
        table.setdefault(spelling.lower(), factor)
    return table


def _spellings(quantity: str) -> Iterator[tuple[str, float]]:
    for symbol, factor in _METRIC.get(quantity, {}).items():
        yield from ((prefix + symbol, size * factor) for prefix, size in _PREFIXES.items())
    for word, factor in _WORDS.get(quantity, {}).items():
        for long, prefix in _LONG_PREFIXES.items():
            yield long + word, _PREFIXES[prefix] * factor
            yield f"{long}{word}s", _PREFIXES[prefix] * factor
    yield from _OTHERS.get(quantity, {}).items()
