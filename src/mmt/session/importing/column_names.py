"""What the names of columns suggest that they hold, also the components of an orientation."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.core.quaternions import LARGEST_OFF
from mmt.core.units import unit_factor
from mmt.session.importing.columns import MESSAGE_PARTS
from mmt.session.importing.options import STANDARD_NAMES, ImportOptions, quantity_of

_OF_TOOL: Final = "(?:(?:robot[0-9]?)?(?:cursor|eef?|tool|tip|tcp|probe|stylus|pen|device))?"
_WORDS: Final = {
    "position": f"p|{_OF_TOOL}(?:pos|position)|tip|tcp|pen|stylus|tool",
    "force": f"f|fn|(?:{_OF_TOOL}|normal)forces?|load(?:cell)?|kraft|ati",
    "acceleration": "(?:linear|total|free)?a(?:cc(?:el(?:eration)?)?)?"
    "|accelerometer(?:uncalibrated)?|imu|adxl|vibration|beschleunigung",
    "speed": "v|vel|velocity|speed",
}
_TIME: Final = re.compile(
    r"^(ts?|((abs|elapsed|relative|system|unix|host|local|ros|sim|robot|device|sensor)_?)?(times?|timestamps?)|stamps?|epoch|clock|(tv)?secs?|seconds|zeit|temps|tiempo|tempo|duration|date|datetime|xvalue)$"
)
_FRACTION: Final = re.compile(r"^(tv)?(n|nano|u|micro|m|milli)s(ecs?|econds?)?$")
"""Matches the name of a part of a second, which may stand beside one of `_SECONDS`."""
_AXIS_OF: Final = re.compile(r"(.+?)(?:[./]|[.:] )([xyzwXYZW])(?: \d+)?")
"""Matches an axis of something, as in ``wrench.force.x``, ``Acc. X`` and ``Left: ACC.X 1``."""
VALUES: Final = re.compile(r"(\.signals)?(\.(_?values?|data|samples|v|xyz))+$", re.IGNORECASE)
"""Matches the end of names of values that their owner's name tells, as in ``acc.data``."""
NUMBER: Final = re.compile(r"\.\d+$")
"""Matches the number that tells columns of one name apart."""
_SENSOR: Final = re.compile(
    r"_?((sensor|topic|device|channel|axis)([ _]?(id|no|nr|number|name))?"
    r"|(?P<texts>source|src|node|signal|variable|quantity|parameter|finger|name|series|metric|field"
    r"|measure(ment)?|marker|body|stream|probe)([ _]?name)?)",
    re.IGNORECASE,
)
"""Matches the name of a column that tells sensors apart."""
_UNITS: Final = re.compile(
    r"((?P<length>length|distance|displacement)|.*?)[ _]?units?", re.IGNORECASE
)
"""Matches the name of units, perhaps of one quantity."""
_OF_UNITS: Final = re.compile(r"(?<![^.])(units)\.([^.]+)$", re.IGNORECASE)
"""Matches a member of a group of units."""
_TRIAL: Final = re.compile(
    r"_?(trial|run|episode|take|session|rep(etition)?|versuch|subject|participant"
    r"|(source[ _]?)?file)([ _.]*(id|no|nr|num|number|name|index|idx|#))?[.:]?",
    re.IGNORECASE,
)
"""Matches the name of a column that tells trials apart."""
_NO_POSITION: Final = re.compile(
    r"(?<![a-z])(rot|quat|orient|euler|ang|gyr|omega|torque|moment|mag)"
)
"""Matches the owner of axes that are not those of a position."""
_COMMANDED: Final = re.compile(
    r"(^|[^a-z])(action|desired|des|target|cmd|command(ed)?|goal|ref(erence)?|set_?point)($|[^a-z])"
)
_NUMBERED: Final = re.compile(r"\d+(?=[./:}])")
"""Matches a number that ends the name of a group."""
_LONGEST_NAME: Final = 256
_COMPONENTS: Final = {f"{channel}_{axis}" for channel in CHANNELS for axis in "xyz"}


def ends_in(name: str, parts: Collection[str]) -> bool:
    """Return whether the name of a topic's field ends in one of these, of one part or more."""
    ends = tuple(f".{part}" for part in parts)
    return "." in name and f".{name}".replace("/", ".").endswith(ends)


@lru_cache(maxsize=4096)
def tells_apart(name: str, *, by_number: bool = False) -> bool:
    """Return whether a column's name says that it tells sensors apart, perhaps by their number."""
    found = _SENSOR.fullmatch(last_part(name))
    return found is not None and not (by_number and found["texts"])


@lru_cache(maxsize=4096)
def tells_trials(name: str) -> bool:
    """Return whether a column's name says that it tells trials apart."""
    return _TRIAL.fullmatch(last_part(name)) is not None


def names_of(elements: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what each element of a list calls itself, or their places if two have one name."""
    names = [
        next((str(value) for key, value in each.items() if _calls(key, value)), "")
        for each in elements
    ]
    distinct = len({*names} - {""}) == len(names)
    return names if distinct else list(map(str, range(len(names))))


def _calls(key: str, value: Any) -> bool:
    text = isinstance(value, str) and (key == "child_frame_id" or tells_apart(key))
    return text or (isinstance(value, int) and tells_apart(key, by_number=True))


@lru_cache(maxsize=4096)
def gives_unit(name: str) -> bool:
    """Return whether a column's name says that it holds the units of another."""
    return unit_of_what(name) is not None


def unit_name(name: str) -> str:
    """Return a name, that of a member of a group of units as if beside it: ``force_units``."""
    return _OF_UNITS.sub(r"\2_\1", name)


def unit_of_what(name: str) -> str | None:
    """Return the quantity whose units a name says that it holds, "" if those of any, or None."""
    found = _UNITS.fullmatch(last_part(unit_name(name)))
    if found is None or not found[1]:
        return found and ""
    target = "position" if found["length"] else target_of(found[1])
    return target and quantity_of(target)


def target_of(name: str) -> str | None:
    """Return the target that a column's name suggests, or None."""
    if name.startswith("/"):  # a topic
        last = name.rsplit(".", 1)[-1]
        of_message = next((q for q, parts in MESSAGE_PARTS.items() if ends_in(name, parts)), None)
        other = target_of(f".{last}") if "." in name else None
        return of_message or (other if other and quantity_of(other) in CHANNELS else None)
    own = re.split(r"\.(?! )|: ", name)[-1]
    spaced = re.sub(r"([a-z])([A-Z][a-z])", r"\1 \2", own).replace("^", "")
    plain = "" if gives_unit(name) else re.sub(r" in (?=\w)", " ", spaced.lower())
    words = re.findall(r"[a-z]+[0-9]?", plain)
    for end in range(len(words), max(0, len(words) - 3), -1):  # the last words may be a unit
        joined, behind = "".join(words[:end]), "_".join(words[end:])
        if not behind and (target := _target_of_whole(joined)):
            return target
        if _TIME.match(joined) and (not behind or unit_factor("time", behind)):
            return "time"
        for quantity, pattern in _WORDS.items():
            if behind and not unit_factor(quantity, behind):
                continue
            optional = "?" if quantity == "position" else ""
            forms = rf"(?:{pattern}){optional}([xyz])", rf"([xyz])(?:axis)?(?=..)(?:{pattern})"
            found = re.fullmatch(forms[0], joined) or re.fullmatch(forms[1], joined)
            if found and quantity != "speed":
                return f"{quantity}_{found.group(1)}"
            of_a_structure = "." in name
            if (len(joined) > 1 or of_a_structure or quantity == "speed") and re.fullmatch(
                pattern, joined
            ):
                return quantity
    return target_of(name.replace(": ", " ")) if ": " in name else None  # what is behind is a unit


def axis_of(name: str) -> re.Match[str] | None:
    """Match a name of an axis of something, its owner being the first group."""
    return _AXIS_OF.fullmatch(VALUES.sub("", NUMBER.sub("", name)))


def target_of_column(name: str, unit: str, owners: Collection[str]) -> str | None:
    """Return the target that a column's name and unit suggest, None if it needs no mapping."""
    plain = NUMBER.sub("", name)
    if axis := axis_of(plain):
        target = _target_of_axis(axis[1], axis[2].lower(), unit, owners)
    elif re.fullmatch("[xyz]", plain, re.IGNORECASE) and (quantity := _of_unit(unit)):
        target = f"{quantity}_{plain.lower()}"
    else:
        owner = VALUES.sub("", plain)  # whose name tells before .data and the like
        of_owner = target_of(f".{owner}") if owner != plain else None
        target = of_owner if quantity_of(of_owner or "") in CHANNELS else target_of(plain)
    if plain != name and (target not in _COMPONENTS or unit_factor("time", unit)):
        return None
    if target == "position_x" and unit_factor("time", unit):  # the X of a plot
        return "time"
    return None if name in STANDARD_NAMES.values() else target


def is_commanded(name: str) -> bool:
    """Return whether a name says that the values are what was asked for, not what was measured."""
    return _COMMANDED.search(name.lower()) is not None


def of_file(name: str, stem: str) -> str:
    """Return a bare axis as one of what its file's name says that it holds, else the name."""
    told = target_of(stem) in CHANNELS or re.match("gyro|magnetometer|gravity", stem.lower())
    return f"{stem}.{name}" if told and re.fullmatch("[xyz]", name, re.IGNORECASE) else name


def of_one_trial(names: Collection[str]) -> tuple[list[str], list[str]]:
    """Return the names without those of other trials than one, and notes for the user.

    Trials are groups that hold the same channel and whose names differ in a number, as ``demo_0``
    and ``demo_1``, or that hold two same channels. The first with most channels is taken.
    """
    groups: dict[str, dict[str, dict[str, str]]] = {}
    for name in names:
        for prefix, number, rest in _in_groups(name):
            groups.setdefault(prefix, {}).setdefault(number, {})[name] = rest
    left_out, notes = set[str](), list[str]()
    for prefix, trials in sorted(groups.items(), key=lambda group: len(group[0])):
        held = {
            number: {rest: _channel_of(rest) for name, rest in of.items() if name not in left_out}
            for number, of in trials.items()
        }
        counts = Counter(each for of in held.values() for each in of.items() if each[1])
        same = {channel for (_, channel), count in counts.items() if count > 1}
        if len(same) >= (1 if all(map(str.isdecimal, trials)) else 2):
            best = max(held, key=lambda number: len({*held[number].values()} - {""}))
            left_out |= {name for number, of in trials.items() if number != best for name in of}
            several = f"{len(trials)} groups that hold the same"
            chosen = f"{prefix}{best}{'}' if prefix.endswith('{') else ''}"
            notes.append(f"of {several}, {chosen} is proposed, no other's columns")
    return [name for name in names if name not in left_out], notes


def _channel_of(name: str) -> str:
    quantity = quantity_of(target_of_column(name, "", ()) or "")
    return quantity if quantity in CHANNELS and len(name) > 1 else ""  # not of a bare axis


def _in_groups(name: str) -> list[tuple[str, str, str]]:
    """Return what stands before each number or group in a name, this, and the rest."""
    dots = [0, *(match.end() for match in re.finditer(r"\.", name[:_LONGEST_NAME]))]
    parts = ((name[:begin], name[begin : end - 1], name[end:]) for begin, end in pairwise(dots))
    found = [] if name.startswith("/") else [each for each in parts if not is_commanded(each[1])]
    for match in _NUMBERED.finditer(name[:_LONGEST_NAME]):
        before, rest = name[: match.start()], name[match.end() + 1 :].strip(" ./")
        if name[match.end()] == "}":  # of MATLAB, after the name
            before, _, last = before.rpartition(".")
            before, rest = f"{before}{{", ".".join(filter(None, (last.strip("{"), rest)))
        found.append((before, match[0], rest))
    return found


def _target_of_axis(owner: str, letter: str, unit: str, owners: Collection[str]) -> str | None:
    """Return the target of an axis by the name before it, its owner.

    If that is no known quantity, or a place, the unit tells; if that tells nothing, the axis is one
    of position if nothing else has axes.
    """
    last = last_part(VALUES.sub("", owner))
    target = next((q for q, parts in MESSAGE_PARTS.items() if last == parts[0]), None)
    target = target or target_of(f".{last}")
    if target not in CHANNELS or target == "position":
        told = "" if _NO_POSITION.search(owner.lower()) else _of_unit(unit)
        of_place = len(owners) == 1 and not _NO_POSITION.search(last.lower())
        target = told or target or ("position" if of_place else "")
    return f"{target}_{letter}" if target in CHANNELS and letter != "w" else None


def _of_unit(unit: str) -> str:
    """Return the quantity that a unit is of, acceleration for g; "" if none."""
    return next((q for q in reversed(CHANNELS) if unit_factor(q, unit)), "")


def _target_of_whole(joined: str) -> str | None:
    """Return the target of a quaternion, or of a part of a second, that joined words suggest."""
    if _FRACTION.match(joined):
        return "time_fraction"
    found = re.fullmatch(r"(?:q|quat|quaternion|orientation)(xyzw|wxyz|[wxyz])", joined)
    if found is None:
        return None
    return f"orientation_{found[1]}" if len(found[1]) == 1 else "orientation"


def last_part(name: str) -> str:
    """Return the last part of a path with dots or slashes."""
    return re.split(r"[./]", name)[-1]


_ROUNDED: Final = 1e-6
"""Deviation of a norm from 1 that is left as it is: that of rounding to single precision."""


def components_mapped(options: ImportOptions, values: Mapping[str, FloatArray]) -> ImportOptions:
    """Return the options with four components mapped in place of an orientation as a whole.

    That is an array (n, 4) whose name tells its order, or a message with the members w to z.
    `orientation`, as mmt exports it, has w first.

    Raises
    ------
    InputError
        It is neither.
    """
    columns = dict(options.columns)
    text = columns.pop("orientation", None)
    name = text or "orientation"
    within = [n[:-2] for n in values if n.startswith(f"{name}.") and n.endswith(".w")]
    if name in values and values[name].shape[1:] == (4,):
        told = "wxyz" if name == "orientation" else name.lower()
        order = next((order for order in ("wxyz", "xyzw") if order in told), None)
        if order is None:
            raise InputError(
                f"orientation is mapped to {name}, whose name does not tell its order, "
                "as q_wxyz or q_xyzw would: map its four components, as in --map "
                f"orientation_w={name}[0]"
            )
        parts = {f"orientation_{axis}": f"{name}[{order.index(axis)}]" for axis in "wxyz"}
    elif text is not None and len(within) == 1:
        parts = {f"orientation_{axis}": f"{within[0]}.{axis}" for axis in "wxyz"}
    elif text is not None:
        raise InputError(
            f"orientation is mapped to {name}, which is no array of shape (n, 4), and no "
            "message with w, x, y and z"
        )
    else:
        return options
    return replace(options, columns={**parts, **columns})


def normalised(quaternions: FloatArray) -> FloatArray:
    """Return quaternions (n, 4), those that are nearly of norm 1 with that norm."""
    norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    off = np.abs(norms - 1.0)
    return quaternions / np.where((off > _ROUNDED) & (off <= LARGEST_OFF), norms, 1.0)
