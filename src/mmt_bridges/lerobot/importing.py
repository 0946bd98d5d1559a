"""Import LeRobot data sets of format v3.0: features as columns, one episode at a time.

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
from mmt.core.frames import FRAMES_HZ
from mmt.core.untrusted_files import require_fetched
from mmt.session.data import RecordedSession
from mmt.session.importing.columns import SourceColumns, distinct, reading
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.parquet_file import read_numbers, read_parquet, read_schema
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
_SHOWN_RANGES: Final = 8
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
    origin = f"import {folder}"
    info = _info(folder, origin)
    files, notes = _whole_files(folder, origin)
    episodes = np.unique(read_numbers(files, ["episode_index"], origin)["episode_index"]).tolist()
    if not episodes:
        raise InputError(f"{origin}: it has no rows{_because(notes)}")
    number = episodes[0] if options.episode is None else options.episode
    if number not in episodes:
        raise InputError(
            f"{origin}: --episode {number}: its episodes are {_ranges(episodes)}{_because(notes)}"
        )
    origin += f", episode {number}"
    if options.episode is None and len(episodes) > 1:
        others = f"this is episode {number} of {len(episodes)}; --episode takes another"
        notes.insert(0, others)
    rows = _Rows(files, info, number, origin)
    file = frames_file(folder, number)
    if file.is_file() and not options.columns:
        try:
            columns = read_parquet(file, wanted, options)
        except InputError as error:
            differ: str | None = str(error)
        else:
            differ = None if columns.frames is None else _differ(columns.frames, rows)
            if differ is None:
                return replace(columns, notes=notes, episode=number)
        notes.append(f"{file.name} is not of these rows ({differ}): the rows alone were read")
        rows.origin = f"{origin} ({notes[-1]})"
    return replace(rows.read(wanted), notes=notes, episode=number)


def _whole_files(folder: Path, origin: str) -> tuple[list[Path], list[str]]:
    """Return the files with rows that can be read, and a note for each of the others."""
    files = sorted((folder / DATA_FOLDER).glob("*/[!.]*.parquet"))
    if not files:
        raise InputError(f"{origin}: there is no file in {folder / DATA_FOLDER}")
    whole, notes = [], []
    for file in files:
        name = file.relative_to(folder)
        try:
            with reading(f"{origin}: {name} was left out", "a file"):
                require_fetched(file)
            read_schema(file, f"{origin}: {name} was left out")
            whole.append(file)
        except InputError as error:
            notes.append(str(error).removeprefix(f"{origin}: "))
    if not whole:
        raise InputError(f"{origin}: {notes[0]}")
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


def _info(folder: Path, origin: str) -> dict[str, Any]:
    try:
        info = json.loads((folder / INFO_FILE).read_text(encoding="utf-8"))
        version = str(info["codebase_version"])
        features = {str(name): dict(feature) for name, feature in info["features"].items()}
        found = {"fps": float(info["fps"])}
        valid = int(info["total_episodes"]) >= 1 and 0 < found["fps"] < float("inf")
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"{origin}: {INFO_FILE} is not that of a LeRobot data set") from error
    if version != FORMAT:
        raise InputError(
            f"{origin}: its format is {version}, only {FORMAT} is read; LeRobot has a script that "
            "converts the one before it (convert_dataset_v21_to_v30)"
        )
    if not valid:
        raise InputError(f"{origin}: it has no episode, or no rate")
    return {**found, "features": features}


class _Rows:
    """The rows of an episode.

    Parameters
    ----------
    files
        Files that hold these rows, among others.
    info
        Rate and features of the data set.
    episode
        Number of the episode.
    origin
        Name of the source, for errors.
    """

    def __init__(
        self, files: Sequence[Path], info: Mapping[str, Any], episode: int, origin: str
    ) -> None:
        self.info, self.origin = info, origin
        self.features = {
            name: _component_names(feature.get("names"))
            for name, feature in info["features"].items()
            if str(feature.get("dtype")) not in _PICTURES
        }
        self._files = files
        self._of_episode = [("episode_index", "==", episode)]

    def numbers(self, names: Iterable[str]) -> dict[str, npt.NDArray[Any]]:
        """Return features (n,) and (n, k) in the order of the rows."""
        wanted = list(dict.fromkeys([*names, "frame_index"]))
        read = read_numbers(self._files, wanted, self.origin, self._of_episode)
        order = np.argsort(read["frame_index"], kind="stable")
        return {name: column[order] for name, column in read.items()}

    def read(self, wanted: Callable[[str], bool]) -> SourceColumns:
        """Return the features and components that are wanted."""
        columns = {
            f"{name}.{component}": (name, place)
            for name, components in self.features.items()
            for place, component in enumerate(components)
        }
        needed = {name for name in self.features if wanted(name)}
        needed |= {name for column, (name, _) in columns.items() if wanted(column)}
        read = self.numbers([*needed, "timestamp"])
        time_s = _times(read["frame_index"], read["timestamp"], self.info["fps"])
        with reading(self.origin, "a data set of numbers", (ValueError, TypeError)):
            values: dict[str, FloatArray] = {n: read[n].astype(np.float64) for n in sorted(needed)}
        for column, (name, place) in columns.items():
            if name in needed and wanted(column):
                values[column] = _component(values[name], place, column, self.origin)
        names = [name for name in (*self.features, *columns) if name not in OF_EVERY_DATA_SET]
        times = dict.fromkeys((*names, *values), time_s)
        return SourceColumns(origin=self.origin, values=values, names=names, times=times)


def _times(frame_index: npt.NDArray[Any], timestamp: npt.NDArray[Any], fps: float) -> FloatArray:
    """Return the rows' times (n,): frame number / rate, if the stored times agree with that."""
    time_s = timestamp.astype(np.float64)
    by_number: FloatArray = frame_index / fps
    off_s = np.abs((time_s - time_s[:1]) - (by_number - by_number[:1]))
    return by_number if bool(np.all(off_s <= _OFF_THE_GRID_S)) else time_s


def _component(values: FloatArray, place: int, column: str, origin: str) -> FloatArray:
    upright = values if values.ndim == 2 else values[:, None]
    if place >= upright.shape[1]:
        raise InputError(f"{origin}: {column} is named in {INFO_FILE}, but has no values")
    return upright[:, place]


def _component_names(names: Any) -> Sequence[str]:
    """Return the names of a feature's components, which some writers nest in maps.

    Components of the same name are numbered, so that each can be mapped.
    """
    return distinct([re.sub(r"[\[\]]", "_", name) for name in _texts(names)])[0]


def _texts(names: Any) -> Iterator[str]:
    if isinstance(names, str):
        yield names
    elif isinstance(names, list | dict):
        for name in names.values() if isinstance(names, dict) else names:
            yield from _texts(name)
