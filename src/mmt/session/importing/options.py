"""What a person says about the columns of a recording, and the units that are understood."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Final

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, check_acceleration_rate
from mmt.core.units import QUANTITIES, unit_factor
from mmt.session.importing.stamps import StampChoice

_AXES = "xyz"

TARGETS: Final = (
    "time",
    *(f"{channel}_time" for channel in CHANNELS),
    *CHANNELS,
    *(f"{channel}_{axis}" for channel in CHANNELS for axis in _AXES),
    "speed",
)
"""What a column may be mapped to: times, vectors (n, 3), single axes, and speed for position."""

MATCHED: Final = "match"
"""The offset of a file that is found by what is in it."""
_SEPARATORS: Final = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}

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
    """The unit of a quantity ("time", "position", "force", "acceleration", "speed") or of one of
    `TARGETS`, in place of what the file says."""
    rate_hz: float | None = None
    """Rows a second, in place of the file's times."""
    blanks_as_gaps: bool = False
    """Leave out rows with an empty cell or NaN, as a gap of their channel."""
    longest_gap_s: float | None = None
    """Samples further apart are not joined; None is five median intervals, 5 to 100 ms."""
    stamps: StampChoice = "auto"
    """Whether times are the "kept" stamps or "regular" ones, see `assess_stamps`."""
    episode: int | None = None
    """The episode of a data set that has several; None is the first."""
    header: int | None = None
    """The line with the names of a table's columns, counted from 1; None looks for it."""
    sheet: str | None = None
    """The sheet of a workbook, by its name or number; None is the one that was open."""
    separator: str | None = None
    """What stands between the cells of a text: comma, semicolon, tab, blank or the sign itself."""
    decimal: str | None = None
    """The decimal sign of a text, "." or ","; None is the point, and a comma where it is one."""
    missing: tuple[str, ...] = ()
    """What stands in cells without a value, beside what mostly does."""
    acceleration_rate_hz: int | None = None
    """Rate at which acceleration is kept, 1000 to 10000 in steps of 1000; None is 1000, or that of
    an exported session."""
    offsets: Mapping[str, str] = field(default_factory=dict)
    """Of several files by name, but the first: seconds that are added to the times, or "match"."""

    def __post_init__(self) -> None:
        for target in self.columns:
            if target not in TARGETS:
                raise InputError(
                    f"--map {target}=...: there is no {target} to map to, only {', '.join(TARGETS)}"
                )
        for target, unit in self.units.items():
            if target not in QUANTITIES and target not in TARGETS:
                raise InputError(
                    f"--unit {target}=...: units are of {', '.join(QUANTITIES)}, or of what is "
                    f"mapped, such as force_z; not of {target}"
                )
            if unit_factor(quantity_of(target), unit) is None:
                raise InputError(
                    f"--unit {target}={unit}: {unit} is no known unit of it; "
                    f"known are {QUANTITIES[quantity_of(target)]}"
                )
        self._check_reading()
        for name in ("rate_hz", "longest_gap_s"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise InputError(f"{name} is {value}, it must be above zero")

    def _check_reading(self) -> None:
        for name, offset in self.offsets.items():
            if offset != MATCHED and not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)", offset):
                raise InputError(
                    f"--offset {name}={offset}: it is a number of seconds, or {MATCHED}"
                )
        if self.acceleration_rate_hz is not None:
            check_acceleration_rate(self.acceleration_rate_hz)
        if self.header is not None and self.header < 1:
            raise InputError(f"--header {self.header}: lines count from 1")
        if self.decimal not in (None, ".", ","):
            raise InputError(f"--decimal {self.decimal}: it is . or ,")
        if self.separator is not None and len(self.delimiter or "") != 1:
            raise InputError(
                f"--separator {self.separator}: it is {', '.join(_SEPARATORS)}, or one sign"
            )

    def arguments(self) -> list[str]:
        """Return the options of the command that say the same of a single file."""
        parts: list[str] = []
        for option, pairs in (("--map", self.columns), ("--unit", self.units)):
            for name, value in pairs.items():
                parts += [option, f"{name}={value}"]
        named = {"columns", "units", "offsets"}
        names = {
            "rate_hz": "rate",
            "longest_gap_s": "longest-gap",
            "acceleration_rate_hz": "acceleration-rate",
        }
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name in named or value == each.default:
                continue
            option = f"--{names.get(each.name, each.name.replace('_', '-'))}"
            values = value if isinstance(value, tuple) else (value,)
            parts += [option] if value is True else [f"{option}={one}" for one in values]
        return parts

    @property
    def delimiter(self) -> str | None:
        """The sign between the cells of a text, None where it is to be found."""
        return None if self.separator is None else _SEPARATORS.get(self.separator, self.separator)

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
        if component is not None and f"{name}[{component}]" in names:
            return Source(f"{name}[{component}]", None, scale)
        return Source(name, None if component is None else int(component), scale)

    def mapped_names(self) -> set[str]:
        """Return every name that a column might have to be one that is mapped."""
        names = set(self.columns.values())
        for text in self.columns.values():
            if found := _SOURCE.match(text):
                names.add(found.group(2))
        return names


def quantity_of(target: str) -> str:
    """Return the quantity of one of `TARGETS`."""
    return "time" if target.endswith("time") else target.split("_", maxsplit=1)[0]


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
