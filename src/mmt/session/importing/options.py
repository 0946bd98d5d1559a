"""Options of an import: columns, units and the format of the file."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Final, get_args

from annotated_types import Gt, Lt

from mmt.core.bounds import check
from mmt.core.errors import InputError
from mmt.core.frames import ALL_CHANNELS, FIELD_OF_CHANNEL, axes_of, check_acceleration_rate
from mmt.core.units import QUANTITIES, unit_factor
from mmt.session.data import axis_columns
from mmt.session.importing.stamps import StampChoice

STANDARD_NAMES: Final[Mapping[str, str]] = {
    "time": "time_s",
    "time_fraction": "time_fraction_s",
    **{f"{channel}_time": f"{channel}_time_s" for channel in ALL_CHANNELS},
    **{str(channel): name for channel, name in FIELD_OF_CHANNEL.items()},
    **{
        f"{channel}_{axis}": name
        for channel in ALL_CHANNELS
        for axis, name in zip(axes_of(channel), axis_columns(channel), strict=True)
    },
}
"""Name of the column for each target but the speed, if it is not mapped."""

TARGETS: Final = (*STANDARD_NAMES, "speed")
"""Targets to map columns to: times, parts of a second to add to time, vectors (n, 3) and
quaternions (n, 4), single axes of them, and speed for position."""

TURNED: Final = ("force", "acceleration")
"""Channels that may be given in the tool's axes."""

MATCHED: Final = "match"
"""Value of an offset that is to be found by matching the content of the files."""
_MOST: Final = 1e9
_SEPARATORS: Final = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}

_SOURCE = re.compile(
    r"^(-?)(.*?)(?:\[(\d+)\])?(?:\*([-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?))?$", re.DOTALL
)


@dataclass(frozen=True)
class Source:
    """Source of a target's values: a column or one of its components, and a factor."""

    name: str
    component: int | None = None
    factor: float = 1.0


@dataclass(frozen=True)
class ImportOptions:
    """Options for reading the columns of a recording.

    Raises
    ------
    InputError
        A target, quantity or unit is not known, or a number is out of range.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    """Column name for each of `TARGETS` whose column does not have the standard name. A minus
    before the name inverts the sign, ``[2]`` after it selects a component of an array, ``*0.5``
    after that scales the values. A number instead of a name is a constant."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Unit of a quantity ("time", "position", "force", "acceleration", "speed") or of one of
    `TARGETS`; overrides the file's unit."""
    rate_hz: float | None = None
    """Rows per second; overrides the file's times. Of several files, if some of them have times,
    it is that of the others."""
    blanks_as_gaps: bool = False
    """Leave out rows with an empty cell or NaN, as gaps of their channel."""
    longest_gap_s: float | None = None
    """Longest gap to interpolate; None: five median intervals, but 5 to 100 ms."""
    stamps: StampChoice = "auto"
    """Whether to use the stamps as they are ("kept") or "regular" times; see `assess_stamps`."""
    episode: int | str | None = None
    """Episode or trial of a file with several, by number or name; None: the first."""
    header: int | None = None
    """Line with the names of a table's columns, counted from 1; None: detect it."""
    sheet: str | None = None
    """Sheet of a workbook, by name or number; None: the active one."""
    separator: str | None = None
    """Separator of cells in a text file: comma, semicolon, tab, blank or the character itself."""
    decimal: str | None = None
    """Decimal sign of a text file, "." or ","; None: a point, or a comma in cells without one."""
    missing: tuple[str, ...] = ()
    """Texts of cells without a value, in addition to common ones."""
    acceleration_rate_hz: int | None = None
    """Rate of the imported acceleration, 1000 to 10000 in steps of 1000; None: 1000, or the rate
    of an exported session."""
    tool_axes: tuple[str, ...] = ()
    """Which of `TURNED` are in the tool's axes; they are turned by the orientation."""
    offsets: Mapping[str, str] = field(default_factory=dict)
    """For several files, except the first: seconds to add to the times, or "match", by name."""
    reading_memory_gb: float | None = None
    """Memory that the reader of a foreign format may take; None: 2 GB and 16 times the file's
    size."""
    reading_time_s: float | None = None
    """Time that it may take; None: 60 s, and 5 s for each MB of the file."""

    def __post_init__(self) -> None:
        for each in fields(self):  # also numbers for texts, and one text for several
            value: Any = getattr(self, each.name)
            if each.default_factory is dict:
                if not isinstance(value, Mapping):
                    raise InputError(f"{each.name} is {value!r}, it must be a dict")
                value = {name: str(text) for name, text in value.items()}
            elif each.type == tuple[str, ...]:
                value = (value,) if isinstance(value, str) else tuple(map(str, value))
            elif each.type == str | None and value is not None:
                value = str(value)
            object.__setattr__(self, each.name, value)
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
                    f"known are {QUANTITIES.get(quantity_of(target), 'none')}"
                )
        self._check_reading()

    def _check_reading(self) -> None:
        for name in ("rate_hz", "longest_gap_s", "reading_memory_gb", "reading_time_s"):
            check(name, getattr(self, name), Annotated[float, Gt(0.0), Lt(_MOST)] | None)
        for name, offset in self.offsets.items():
            if offset != MATCHED and not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)", offset):
                raise InputError(
                    f"--offset {name}={offset}: it is a number of seconds, or {MATCHED}"
                )
        if self.stamps not in (choices := get_args(StampChoice)):
            raise InputError(f"--stamps {self.stamps}: it is {', '.join(choices)}")
        if self.acceleration_rate_hz is not None:
            check_acceleration_rate(self.acceleration_rate_hz)
        for channel in self.tool_axes:
            if channel not in TURNED:
                raise InputError(f"--tool-axes {channel}: it is {' or '.join(TURNED)}")
        if self.header is not None and self.header < 1:
            raise InputError(f"--header {self.header}: lines count from 1")
        if self.decimal not in (None, ".", ","):
            raise InputError(f"--decimal {self.decimal}: it is . or ,")
        if self.separator is not None and len(self.delimiter or "") != 1:
            raise InputError(
                f"--separator {self.separator}: it is {', '.join(_SEPARATORS)}, or one sign"
            )

    def arguments(self) -> list[str]:
        """Return the equivalent command-line options for a single file."""
        parts: list[str] = []
        for option, pairs in (("--map", self.columns), ("--unit", self.units)):
            for name, value in pairs.items():
                parts += [option, f"{name}={value}"]
        named = {"columns", "units", "offsets"}
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name in named or value == each.default:
                continue
            option = f"--{re.sub('_(hz|gb|s)$', '', each.name).replace('_', '-')}"
            values = value if isinstance(value, tuple) else (value,)
            parts += [option] if value is True else [f"{option}={one}" for one in values]
        return parts

    @property
    def delimiter(self) -> str | None:
        """Character between the cells of a text file, or None if it must be detected."""
        return None if self.separator is None else _SEPARATORS.get(self.separator, self.separator)

    def source(self, target: str, names: "Mapping[str, object]") -> Source | None:
        """Return the source of a target, or None if the target is not mapped.

        A text that is a column's name as a whole is not parsed.
        """
        text = self.columns.get(target)
        if text is None or text in names:
            return None if text is None else Source(text)
        sign, name, component, factor = _SOURCE.findall(text)[0]
        scale = (-1.0 if sign else 1.0) * float(factor or 1.0)
        if component and f"{name}[{component}]" in names:
            return Source(f"{name}[{component}]", None, scale)
        return Source(name, int(component) if component else None, scale)

    def mapped_names(self) -> set[str]:
        """Return every name that a mapped column may have."""
        texts = self.columns.values()
        return {*texts, *(_SOURCE.findall(text)[0][1] for text in texts)}


def quantity_of(target: str) -> str:
    """Return the quantity of one of `TARGETS`."""
    return "time" if target.endswith("time") else target.split("_", maxsplit=1)[0]


def assignments(texts: list[str], option: str) -> dict[str, str]:
    """Return a dict from texts of the form ``name=value``; `option` is for messages.

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
