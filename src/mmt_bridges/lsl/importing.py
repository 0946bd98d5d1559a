"""XDF files, as LabRecorder writes them: the channels of each stream as ``STREAM.LABEL``.

The streams of `mmt_bridges.lsl.streams` also have the names of an exported session.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.extras import require
from mmt.session.data import JsonObject
from mmt.session.importing.columns import SourceColumns, distinct, parsed_events, reading
from mmt.session.importing.options import STANDARD_NAMES, ImportOptions
from mmt_bridges.lsl.streams import MANUFACTURER, UTC_AHEAD

_STANDARD = frozenset(STANDARD_NAMES.values())


def read_xdf(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> SourceColumns:
    """Read the wanted channels (n,) of the streams, and the events of mmt's streams.

    Times are the stamps by the clock of the recording computer, not smoothed, from the earliest on.

    Raises
    ------
    InputError
        pyxdf is not installed, or the file is missing or not an XDF file.
    """
    require("pyxdf")
    import pyxdf

    with reading("an XDF file"), path.open("rb") as file:
        found, _ = pyxdf.load_xdf(file, dejitter_timestamps=False)
        called, notes = distinct([stream["info"]["name"][0] for stream in found])
        streams = [_Stream(name, stream) for name, stream in zip(called, found, strict=True)]
        notes += [note for stream in streams for note in stream.notes]
        sampled = [each for each in streams if each.numeric and len(each.stamps_s)]
        begin_s = min((each.stamps_s.min() for each in sampled), default=0.0)
        values: dict[str, FloatArray] = {}
        times: dict[str, FloatArray] = {}
        units: dict[str, str] = {}
        for stream in sampled:
            time_s = stream.stamps_s - begin_s
            for name, unit, column in stream.channels():
                if name not in times:  # a second leader's only have their stream's name
                    times[name] = time_s
                    units |= {name: unit} if unit else {}
                    values |= {name: column.astype(np.float64)} if wanted(name) else {}
        return SourceColumns(
            values=values,
            names=list(times),
            units=units,
            times=times,
            events=[event for stream in streams for event in stream.events()],
            notes=notes,
            began_utc_ns=next((s.utc_ns(begin_s) for s in sampled if s.dated), None),
        )


class _Stream:
    """A stream as pyxdf returns it, with a list for each element of its XML."""

    def __init__(self, name: str, stream: Mapping[str, Any]) -> None:
        self._name, self._stream = name, stream
        self._told: Mapping[str, Any] = _first(stream["info"], "desc") or {}
        described = _first(self._told, "channels") or {}
        width = int(stream["info"]["channel_count"][0])
        self._about = [*described.get("channel", []), *[{}] * width][:width]
        self._labels, self.notes = distinct([_first(each, "label") for each in self._about])
        if stream.get("footer") is None:
            self.notes.append(f"{name} was not finished: it was read as far as it goes")
        self.stamps_s = stream["time_stamps"]
        self.numeric = stream["info"]["channel_format"][0] != "string"
        self._of_mmt = self._told.get("manufacturer") == [MANUFACTURER]
        self.dated = self._of_mmt and UTC_AHEAD in self._told

    def channels(self) -> Iterator[tuple[str, str, Any]]:
        """Yield name, unit and samples of each channel."""
        columns = self._stream["time_series"].T
        for about, label, column in zip(self._about, self._labels, columns, strict=True):
            unit = _first(about, "unit")
            yield f"{self._name}.{label}", unit, column
            if self._of_mmt and label in _STANDARD:
                yield label, unit, column

    def events(self) -> Iterator[JsonObject]:
        """Yield the events, if this is a leader's stream of events."""
        if self._of_mmt and not self.numeric:
            texts = ", ".join(sample[0] for sample in self._stream["time_series"])
            yield from parsed_events(f"[{texts}]", f"its events: {self._name}")

    def utc_ns(self, time_s: float) -> int:
        """Convert a time by the recording computer's clock to UTC since 1970."""
        corrected_s = float(np.median(self._stream["clock_values"] or [0.0]))
        return round((time_s - corrected_s) * 1e9) + int(self._told[UTC_AHEAD][0])


def _first(element: Mapping[str, Any], name: str) -> Any:
    """Return what is in an element's first child of a name, or "" if there is nothing."""
    return (element.get(name) or [None])[0] or ""
