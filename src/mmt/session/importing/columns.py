"""The columns of a recording as they stand in its file, and the samples that they are mapped to."""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL, Channel
from mmt.session.data import JsonObject, axis_columns
from mmt.session.importing.options import ImportOptions, Source, unit_factor
from mmt.session.importing.samples import ROW_NUMBER, Samples

MESSAGE_PARTS: Final = {
    "position": ("position", "translation", "point"),
    "force": ("force",),
    "acceleration": ("linear_acceleration", "linear", "vector"),
}
"""Names that a vector has within a ROS message, by quantity."""

_SHOWN_COLUMNS = 12
_SHOWN_CHARACTERS = 60

STANDARD_NAMES: Final[Mapping[str, str]] = {
    "time": "time_s",
    **{f"{channel}_time": f"{channel}_time_s" for channel in CHANNELS},
    **{str(channel): name for channel, name in FIELD_OF_CHANNEL.items()},
    **{
        f"{channel}_{axis}": name
        for channel in CHANNELS
        for axis, name in zip("xyz", axis_columns(channel), strict=True)
    },
}
"""The column that a target takes where it is not mapped."""


@dataclass(frozen=True, eq=False)
class Columns:
    """What a file holds, unchanged."""

    origin: str
    """The file, for errors."""
    values: Mapping[str, FloatArray]
    """Columns (n,) and arrays (n, k) by name."""
    names: Sequence[str] = ()
    """Every name in the file, also of what was not read."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the file states, by column."""
    times: Mapping[str, FloatArray] = field(default_factory=dict)
    """Times (n,) in s of columns that have them from the file itself, as ROS messages have."""
    row_name: Callable[[int], str] = ROW_NUMBER.format
    scene: JsonObject | None = None
    annotations: bytes = b""
    events: Sequence[JsonObject] = ()
    frames: RecordArray | None = None
    """The frames (n,) themselves, where the file is a session that mmt wrote."""
    notes: Sequence[str] = ()
    """What a person should know of how the file was read."""
    began_utc_ns: int | None = None
    """UTC of the earliest of `times` since 1970, None where the file has no dates."""
    episode: int | None = None
    """Number of the episode that was read, None if it is no data set with episodes."""


def wanted_names(options: ImportOptions) -> Callable[[str], bool]:
    """Return a function that says whether a column of a name is to be read."""
    names = {"sequence", *STANDARD_NAMES.values(), *options.mapped_names()}
    return lambda name: (
        name in names or any(name[: place.start()] in names for place in re.finditer(r"\.", name))
    )


def to_samples(columns: Columns, options: ImportOptions) -> Samples:
    """Return the channels that the columns hold, in the units of frames.

    Raises
    ------
    InputError
        A column is missing or has another shape, or there are no times.
    """
    return _Mapping(columns, options).samples()


def listed(names: Sequence[str]) -> str:
    """Name columns in a text that stays short however many there are, and however long."""
    shown = ", ".join(name[:_SHOWN_CHARACTERS] for name in names[:_SHOWN_COLUMNS])
    if len(names) <= _SHOWN_COLUMNS:
        return f"the columns are {shown or 'none'}"
    return f"the first of {len(names)} columns are {shown}"


def parsed_scene(text: str | bytes | None, name: str, origin: str) -> JsonObject | None:
    """Return the scene of an exported session out of its JSON, None where it has none.

    Raises
    ------
    InputError
        It is not a JSON object; the message has the name under which the file holds it.
    """
    scene = _parsed(text, name, origin)
    if scene is None:
        return None
    if not isinstance(scene, dict):
        raise InputError(f"{origin}: {name} is not a JSON object")
    return scene


def parsed_events(text: str | bytes | None, name: str, origin: str) -> Sequence[JsonObject]:
    """Return the events of an exported session out of their JSON.

    Raises
    ------
    InputError
        They are not a list of JSON objects; the message has the name as of `parsed_scene`.
    """
    events = _parsed(text, name, origin)
    if events is None:
        return ()
    if not isinstance(events, list) or not all(isinstance(event, dict) for event in events):
        raise InputError(f"{origin}: {name} is not a list of JSON objects")
    return events


def _parsed(text: str | bytes | None, name: str, origin: str) -> Any:
    try:
        return None if text is None else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{origin}: {name} is not valid JSON: {error}") from error


def _shared(time_s: FloatArray, others: Iterable[FloatArray]) -> FloatArray:
    """Return that of the others which has the same times (n,), these where none has."""
    alike = (other for other in others if np.array_equal(other, time_s, equal_nan=True))
    return next(alike, time_s)


class _Mapping:
    def __init__(self, columns: Columns, options: ImportOptions) -> None:
        self._columns = columns
        self._options = options
        self._origin = columns.origin

    def samples(self) -> Samples:
        values: dict[Channel, FloatArray] = {}
        times: dict[Channel, FloatArray] = {}
        for channel in CHANNELS:
            vectors = self._vectors(channel)
            if vectors is None:
                continue
            name, time_s = self._time(channel, len(vectors))
            if len(time_s) != len(vectors):
                raise InputError(
                    f"{self._origin}: {channel} has {len(vectors)} rows, its times "
                    f"({name}) {len(time_s)}"
                )
            values[channel] = vectors
            times[channel] = _shared(time_s, times.values())
        if not values:
            raise InputError(
                f"{self._origin}: it holds none of {', '.join(FIELD_OF_CHANNEL.values())}, and "
                f"nothing is mapped to them (--map force_z=NAME); "
                f"{listed(self._columns.names)}; mmt session inspect proposes a command"
            )
        sequence = self._columns.values.get("sequence")
        return Samples(self._origin, values, times, sequence, self._columns.row_name)

    def _vectors(self, channel: Channel) -> FloatArray | None:
        whole = self._column(channel, channel)
        if whole is not None:
            if whole.ndim != 2 or whole.shape[1] != 3:
                raise InputError(
                    f"{self._origin}: {channel} has shape {whole.shape}, it must have shape (n, 3)"
                )
            return whole
        axes = {axis: self._column(f"{channel}_{axis}", channel) for axis in "xyz"}
        given = {axis: values for axis, values in axes.items() if values is not None}
        if not given:
            return None
        for axis in "xyz":
            if axis not in given:
                raise InputError(
                    f"{self._origin}: {channel}_{axis} is missing (the column "
                    f"{STANDARD_NAMES[f'{channel}_{axis}']}); map it, to 0 where there is none: "
                    f"--map {channel}_{axis}=0"
                )
        lengths = {len(values) for values in given.values() if values.ndim}
        if len(lengths) != 1:
            raise InputError(
                f"{self._origin}: the three axes of {channel} end in different rows: "
                f"{', '.join(map(str, sorted(lengths))) or 'all are constants'}"
            )
        rows = lengths.pop()
        return np.column_stack([np.broadcast_to(given[axis], rows) for axis in "xyz"])

    def _column(self, target: str, quantity: str) -> FloatArray | None:
        """Return a target's values in the unit of frames, shape () for a constant."""
        source = self._source(target, quantity)
        if isinstance(source, float) and quantity == "time":
            raise InputError(
                f"{self._origin}: {target} is mapped to the number {source:g}, it must be a "
                "column; for a file without times give --rate HZ"
            )
        if source is None or isinstance(source, float):
            return None if source is None else np.array(source)
        values = self._columns.values[source.name]
        if source.component is not None:
            if values.ndim != 2 or source.component >= values.shape[1]:
                raise InputError(
                    f"{self._origin}: {target} is mapped to component {source.component} of "
                    f"{source.name}, which has shape {values.shape}; components count from 0"
                )
            values = values[:, source.component]
        lacks_rows = quantity == "time" and values.ndim == 0
        if target not in CHANNELS and (values.ndim > 1 or lacks_rows):
            raise InputError(
                f"{self._origin}: {source.name} has shape {values.shape}, it must have shape (n,) "
                f"for {target}; a component is mapped as in --map {target}={source.name}[0]"
            )
        scaled = self._scaled(source.name, values, quantity)
        return scaled if source.factor == 1.0 else source.factor * scaled

    def _source(self, target: str, quantity: str) -> Source | float | None:
        """Return the column of a target, or its constant; None where it has none."""
        columns = self._columns.values
        source = self._options.source(target, columns)
        if source is None:
            name = STANDARD_NAMES[target]
            return Source(name) if name in columns else None
        if source.name in columns:
            return source
        try:
            return float(self._options.columns[target])
        except ValueError:
            pass
        within = [name for name in columns if name.startswith(f"{source.name}.")]
        if target == quantity:  # vectors; a single axis is mapped to a column of its own
            within = [name for name in within if columns[name].shape[1:] == (3,)]
        if len(within) > 1:
            parts = MESSAGE_PARTS.get(quantity, (quantity,))
            within = [name for name in within if name.rsplit(".", 1)[-1] in parts]
        if len(within) == 1:
            return replace(source, name=within[0])
        raise InputError(
            f"{self._origin}: {target} is mapped to {source.name}, which is not there; "
            f"{listed(self._columns.names)}"
        )

    def _scaled(self, name: str, values: FloatArray, quantity: str) -> FloatArray:
        unit = self._options.units.get(quantity) or self._columns.units.get(name)
        factor = unit_factor(quantity, unit) if unit else None
        return values if factor is None or factor == 1.0 else factor * values

    def _time(self, channel: Channel, rows: int) -> tuple[str, FloatArray]:
        """Return the name and the times (n,) of a channel."""
        for target in (f"{channel}_time", "time"):
            column = self._column(target, "time")
            if column is not None:
                return self._options.columns.get(target, STANDARD_NAMES[target]), column
        for target in (channel, *(f"{channel}_{axis}" for axis in "xyz")):
            source = self._source(target, channel)
            if isinstance(source, Source) and source.name in self._columns.times:
                return source.name, self._columns.times[source.name]
        if self._options.rate_hz is not None:
            return "row number", np.arange(rows) / self._options.rate_hz
        raise InputError(
            f"{self._origin}: there is no column time_s, nor one that is mapped to it (--map "
            f"time=NAME); for a file without times give --rate HZ; {listed(self._columns.names)}"
        )
