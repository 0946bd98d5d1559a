"""Import LeRobot data sets of formats v2.0 to v3.0: features as columns, one episode at a time.

Frames that mmt left beside an episode are used only if its rows match them: other tools delete,
merge and renumber episodes without these files.
"""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.files.untrusted import require_fetched
from mmt.core.frames import FRAMES_HZ
from mmt.session.data import RecordedSession
from mmt.session.importing.columns import SourceColumns, distinct, named, reading
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.parquet_file import read_numbers, read_parquet, read_schema
from mmt_bridges.lerobot.rows import (
    DATA_FOLDER,
    FORMAT,
    INFO_FILE,
    OF_EVERY_DATA_SET,
    STATE,
    frames_file,
    low_rate_rows,
)

_PICTURES: Final = ("image", "video", "string", "language")
"""Kinds of features without numbers."""
_FORMATS: Final = ("v2.0", "v2.1", FORMAT)
_SHOWN_RANGES: Final = 8
_OTHER_RATE: Final = 0.05
"""Share by which the timestamps' rate may differ from that of the data set without a word."""
_OFF_THE_GRID_S: Final = 1e-3
"""Largest difference of a row's time, in single precision, from its frame number / rate."""


def read_lerobot(
    folder: Path, wanted: Callable[[str], bool], options: ImportOptions
) -> SourceColumns:
    """Read an episode: the 1 kHz frames that mmt left beside it if they match, else its rows.

    Of the rows, features (n,) and (n, k) have their own names, and named components the names
    ``FEATURE.COMPONENT``.

    Parameters
    ----------
    folder
        The data set.
    wanted
        Whether a column is read.
    options
        With the episode's number, None for the first; if they map columns, the rows are read.

    Raises
    ------
    InputError
        pyarrow is not installed, the data set is of another format or not valid, or has no such
        episode.
    """
    info = _info(folder)
    files, notes = _whole_files(folder)
    with reading("a data set with numbered episodes", (ValueError, TypeError)):
        of_rows = {
            file: read_numbers(file, ["episode_index"])["episode_index"].ravel().astype(int)
            for file in files
        }
    episodes = np.unique(np.concatenate(list(of_rows.values()))).tolist()
    if not episodes:
        raise InputError(f"it has no rows{_because(notes)}")
    if info["episodes"] > len(episodes):
        notes.append(f"{INFO_FILE} counts {info['episodes']} episodes, {len(episodes)} are here")
    asked = str(episodes[0] if options.episode is None else options.episode)
    number = int(asked) if asked.isdecimal() else -1
    if number not in episodes:
        raise InputError(
            f"--episode {asked}: its episodes are {_ranges(episodes)}{_because(notes)}"
        )
    if options.episode is None and len(episodes) > 1:
        others = f"this is episode {number} of {len(episodes)}; --episode takes another"
        notes.insert(0, others)
    chosen = {file: np.flatnonzero(of_rows[file] == number) for file in files}
    origin = f"import {folder}, episode {number}"
    with named(origin):
        rows = _Rows({file: places for file, places in chosen.items() if len(places)}, info)
        file = frames_file(folder, number)
        if file.is_file() and not options.columns:
            try:
                columns = read_parquet(file, wanted, options)
            except InputError as error:
                differ: str | None = f"import {file}: {error}"
            else:
                differ = None if columns.frames is None else _differ(columns.frames, rows)
                if differ is None:
                    return replace(columns, notes=notes, episode=number, origin=origin)
            notes.append(f"{file.name} is not of these rows ({differ}): the rows alone were read")
            origin += f" ({notes[-1]})"
    with named(origin):
        columns = rows.read(wanted)
    return replace(columns, notes=[*notes, *rows.notes], episode=number, origin=origin)


def _whole_files(folder: Path) -> tuple[list[Path], list[str]]:
    """Return the files with rows that can be read, and a note for each of the others."""
    files = sorted((folder / DATA_FOLDER).glob("*/[!.]*.parquet"))
    if not files:
        raise InputError(f"there is no file in {folder / DATA_FOLDER}")
    whole, notes = [], []
    for file in files:
        name = file.relative_to(folder)
        try:
            with reading("a file"):
                require_fetched(file)
            stored, _, _ = read_schema(file)
            lacking = sorted({"episode_index", "frame_index"} - set(stored))
            if lacking:
                notes.append(f"{name} was left out: it has no column {lacking[0]}")
            else:
                whole.append(file)
        except InputError as error:
            notes.append(f"{name} was left out: {error}")
    if not whole:
        raise InputError(notes[0])
    return whole, notes


def _because(notes: Sequence[str]) -> str:
    return f"; {notes[0]}" if notes else ""


def _ranges(numbers: Sequence[int]) -> str:
    """Return rising numbers as in "0 to 3, 7"."""
    runs = np.split(np.array(numbers), np.flatnonzero(np.diff(numbers) > 1) + 1)
    texts = [f"{r[0]}" if len(r) == 1 else f"{r[0]} to {r[-1]}" for r in runs[:_SHOWN_RANGES]]
    return ", ".join(texts if len(runs) <= _SHOWN_RANGES else [*texts, "..."])


def _differ(frames: RecordArray, rows: "_Rows") -> str | None:
    """Return how the rows made from frames (n,) differ from `rows`, or None if they do not."""
    fps = rows.info["fps"]
    names = {STATE, "action"} & rows.features.keys()
    if not names or fps not in range(1, FRAMES_HZ + 1):
        return "nothing can be compared"
    found = rows.numbers([*sorted(names), "frame_index"])
    try:
        made = low_rate_rows(RecordedSession(frames), int(fps))
    except InputError:
        return "they make no row"
    for name in ("frame_index", *sorted(names)):
        ours, theirs = made.get(name), found[name]
        if ours is None or len(ours) != len(theirs):
            return f"{0 if ours is None else len(ours)} rows of {name} for {len(theirs)}"
        if ours.shape != theirs.shape or not np.array_equal(ours, theirs, equal_nan=True):
            return f"another {name}"
    return None


def _info(folder: Path) -> dict[str, Any]:
    try:
        info = json.loads((folder / INFO_FILE).read_text(encoding="utf-8-sig"))
        version = str(info["codebase_version"])
        features = {str(name): dict(feature) for name, feature in info["features"].items()}
        found = {"fps": float(info["fps"]), "episodes": int(info.get("total_episodes") or 0)}
        valid = 0 < found["fps"] < float("inf")
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{INFO_FILE} is not that of a LeRobot data set") from error
    if version not in _FORMATS:
        raise InputError(
            f"its format is {version}, read are {', '.join(_FORMATS)}; LeRobot has "
            "scripts that convert older ones"
        )
    if not valid:
        raise InputError(f"{INFO_FILE} has no rate (fps)")
    return {**found, "features": features}


class _Rows:
    """The rows of an episode.

    Parameters
    ----------
    files
        Files that hold these rows, and their places in each.
    info
        Rate and features of the data set.

    Raises
    ------
    InputError
        A row has no number.
    """

    def __init__(self, files: Mapping[Path, npt.NDArray[Any]], info: Mapping[str, Any]) -> None:
        self.info = info
        self.notes: list[str] = []
        self._files = files
        stored = set.intersection(*(set(read_schema(file)[0]) for file in files))
        self.features: dict[str, Sequence[str]] = {
            name: self._named(name, feature)
            for name, feature in info["features"].items()
            if str(feature.get("dtype")) not in _PICTURES and name in stored
        }
        read = self._read(["frame_index", *({"timestamp"} & stored)])
        number, time_s = read["frame_index"], read.get("timestamp")
        if time_s is not None and len(np.unique(number)) < len(number) and _rise(time_s):
            number = np.arange(len(number))  # what the file has are no numbers of rows
        self._order = np.argsort(number, kind="stable")
        number = number[self._order]
        self._twice = np.diff(number) == 0
        self.time_s = self._times(number, None if time_s is None else time_s[self._order])

    def _named(self, name: str, feature: Mapping[str, Any]) -> Sequence[str]:
        """Return the names of a feature's components, none if they are not one for each."""
        names = _component_names(feature.get("names"))
        shape = feature.get("shape")
        count = int(np.prod(shape)) if isinstance(shape, list) else len(names)
        if not names or len(names) == count:
            return names
        if count > 1:
            self.notes.append(
                f"{name} has {count} numbers and {len(names)} names, which were left out: map its "
                f"components by number ({name}[0])"
            )
        return ()

    def _read(self, names: Iterable[str]) -> dict[str, npt.NDArray[Any]]:
        """Return features (n,) and (n, k) in the order of the files."""
        wanted = list(dict.fromkeys(names))
        parts: dict[str, list[npt.NDArray[Any]]] = {name: [] for name in wanted}
        for file, places in self._files.items():
            for name, column in read_numbers(file, wanted).items():
                part = column[places]
                parts[name].append(part[:, 0] if part.shape[1:] == (1,) else part)
        with reading("a data set whose files agree", (ValueError, TypeError)):
            return {name: np.concatenate(each) for name, each in parts.items()}

    def _times(self, number: npt.NDArray[Any], time_s: npt.NDArray[Any] | None) -> FloatArray:
        """Return times (n,): frame number / rate, if stored times agree with that."""
        by_number: FloatArray = number / self.info["fps"]
        if time_s is None:
            return by_number
        stored_s = time_s.astype(np.float64)
        off_s = np.abs((stored_s - stored_s[:1]) - (by_number - by_number[:1]))
        if bool(np.all(off_s <= _OFF_THE_GRID_S)):
            return by_number
        step_s = float(np.median(np.diff(stored_s))) if len(stored_s) > 1 else 0.0
        if abs(step_s * self.info["fps"] - 1.0) > _OTHER_RATE:
            self.notes.append(
                f"the rows are {step_s:.4g} s apart by their timestamps, which were taken, and "
                f"{1 / self.info['fps']:.4g} s by {INFO_FILE} (--rate {self.info['fps']:g})"
            )
        return stored_s

    def numbers(self, names: Iterable[str]) -> dict[str, npt.NDArray[Any]]:
        """Return features (n,) and (n, k) in the order of the rows.

        Raises
        ------
        InputError
            Rows of one number differ: they are of several recordings.
        """
        read = {name: column[self._order] for name, column in self._read(names).items()}
        for name, column in read.items():
            one, other = column[1:][self._twice], column[:-1][self._twice]
            if not np.array_equal(one, other, equal_nan=column.dtype.kind == "f"):
                files = ", ".join(file.name for file in self._files)
                raise InputError(
                    f"{np.sum(self._twice)} rows have the frame_index of another "
                    f"row, and another {name}: several recordings have this episode's number "
                    f"({files})"
                )
        return read

    def read(self, wanted: Callable[[str], bool]) -> SourceColumns:
        """Return the features and components that are wanted."""
        columns = {
            f"{name}.{component}": (name, place)
            for name, components in self.features.items()
            for place, component in enumerate(components)
        }
        needed = {name for name in self.features if wanted(name)}
        needed |= {name for column, (name, _) in columns.items() if wanted(column)}
        read = self.numbers(needed)
        with reading("a data set of numbers", (ValueError, TypeError)):
            values: dict[str, FloatArray] = {n: read[n].astype(np.float64) for n in sorted(needed)}
        for column, (name, place) in columns.items():
            if name in needed and wanted(column):
                values[column] = self._component(values[name], place, column, name)
        names = [name for name in (*self.features, *columns) if name not in OF_EVERY_DATA_SET]
        times = dict.fromkeys((*names, *values), self.time_s)
        return SourceColumns(values=values, names=names, times=times)

    def _component(self, values: FloatArray, place: int, column: str, name: str) -> FloatArray:
        upright = values if values.ndim == 2 else values[:, None]
        if len(self.features[name]) != upright.shape[1]:
            raise InputError(
                f"{column} cannot be told: {INFO_FILE} has "
                f"{len(self.features[name])} names for the {upright.shape[1]} numbers of {name}; "
                f"map it by number, as {name}[{place}]"
            )
        return upright[:, place]


def _rise(values: npt.NDArray[Any]) -> bool:
    return bool(np.all(np.diff(values) > 0))


def _component_names(names: Any) -> Sequence[str]:
    """Return the names of a feature's components, which some writers nest in maps.

    Components of the same name are numbered, so that each can be mapped.
    """
    return distinct([re.sub(r"[\[\]]", "_", name) for name in _texts(names)])[0]


def _texts(names: Any) -> Iterator[str]:
    if isinstance(names, str):
        yield names
    elif isinstance(names, dict) and all(isinstance(each, int) for each in names.values()):
        yield from sorted(names, key=names.__getitem__)  # each name with its place
    elif isinstance(names, list | dict):
        for name in names.values() if isinstance(names, dict) else names:
            yield from _texts(name)
