"""What a person says about the columns of a recording, and the units that are understood."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS
from mmt.session.importing.stamps import StampChoice

_AXES = "xyz"

TARGETS: Final = (
    "time",
    *(f"{channel}_time" for channel in CHANNELS),
    *CHANNELS,
    *(f"{channel}_{axis}" for channel in CHANNELS for axis in _AXES),
)
"""What a column may be mapped to: times, vectors (n, 3), and single axes."""

UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0},
    "position": {"mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3, "µm": 1e-3, "in": 25.4},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216},
    "acceleration": {
        **dict.fromkeys(("m/s2", "m/s^2", "m/s²", "m_s2"), 1.0),
        **dict.fromkeys(("mm/s2", "mm/s^2", "mm/s²"), 1e-3),
        "g": 9.80665,
        "mg": 9.80665e-3,
    },
}
"""Factors to s, mm, N and m/s², by quantity."""

_SOURCE = re.compile(
    r"^(-?)(.*?)(?:\[(\d+)\])?(?:\*([-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?))?$", re.DOTALL
)


@dataclass(frozen=True)
class Source:
    """Where the values of a target come from: a column, one of its components, or a constant."""

    name: str
    component: int | None = None
    factor: float = 1.0


@dataclass(frozen=True)
class ImportOptions:
    """How the columns of a recording are to be read.

    Raises
    ------
    InputError
        A target, quantity or unit is not known, or a number is out of range.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    """A column's name for each of `TARGETS` whose column has not the standard name. A minus
    before it turns the sign, ``[2]`` after it takes that component of an array, ``*0.5`` behind
    that scales it, and a number is a constant."""
    units: Mapping[str, str] = field(default_factory=dict)
    """The unit of "time", "position", "force", "acceleration" where the file does not say it."""
    rate_hz: float | None = None
    """Rows a second of a file without times."""
    blanks_as_gaps: bool = False
    """Leave out rows with an empty cell or NaN, as a gap of their channel."""
    longest_gap_s: float | None = None
    """Samples further apart are not joined; None is five median intervals, 5 to 100 ms."""
    stamps: StampChoice = "auto"
    """Whether times are the "kept" stamps or "regular" ones, see `assess_stamps`."""
    episode: int | None = None
    """The episode of a data set that has several; None is the first."""

    def __post_init__(self) -> None:
        for target in self.columns:
            if target not in TARGETS:
                raise InputError(
                    f"--map {target}=...: there is no {target} to map to, only {', '.join(TARGETS)}"
                )
        for quantity, unit in self.units.items():
            if quantity not in UNITS:
                raise InputError(
                    f"--unit {quantity}=...: units are of {', '.join(UNITS)}, not of {quantity}"
                )
            if unit_factor(quantity, unit) is None:
                raise InputError(
                    f"--unit {quantity}={unit}: {unit} is no known unit of it; "
                    f"known are {', '.join(UNITS[quantity])}"
                )
        for name in ("rate_hz", "longest_gap_s"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise InputError(f"{name} is {value}, it must be above zero")

    def source(self, target: str, names: "Mapping[str, object]") -> Source | None:
        """Return what a target is mapped to, None where it is not mapped.

        A name that is a column's as it stands is that column, whatever signs are in it.
        """
        text = self.columns.get(target)
        if text is None or text in names:
            return None if text is None else Source(text)
        found = _SOURCE.match(text)
        if found is None:
            return Source(text)
        sign, name, component, factor = found.groups()
        scale = (-1.0 if sign else 1.0) * float(factor or 1.0)
        return Source(name, None if component is None else int(component), scale)

    def mapped_names(self) -> set[str]:
        """Return every name that a column might have to be one that is mapped."""
        names = set(self.columns.values())
        for text in self.columns.values():
            if found := _SOURCE.match(text):
                names.add(found.group(2))
        return names


def unit_factor(quantity: str, unit: str) -> float | None:
    """Return the factor to the unit of frames, None for a unit that is not known."""
    known = UNITS[quantity]
    if unit in known:
        return known[unit]
    plain = {name.lower(): factor for name, factor in known.items()}
    return plain.get(unit.strip().lower())


def assignments(texts: list[str], option: str) -> dict[str, str]:
    """Split texts of the form ``name=value``.

    Raises
    ------
    InputError
        A text has another form, or a name is given twice.
    """
    pairs: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise InputError(f"{option} {text}: it must have the form NAME=VALUE")
        if name in pairs:
            raise InputError(f"{option} {text}: {name} is given twice")
        pairs[name] = value
    return pairs
