"""LeRobot data sets of format v3.0: features as columns, an episode at a time."""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.session.importing.columns import Columns
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.parquet_file import read_numbers, read_parquet
from mmt_bridges.lerobot.layout import (
    DATA_FOLDER,
    FORMAT,
    INFO_FILE,
    OF_EVERY_DATA_SET,
    frames_file,
)

_PICTURES: Final = ("image", "video", "string", "language")
"""Kinds of features without numbers."""
_OFF_THE_GRID_S: Final = 1e-3
"""How far a time, which is in single precision, may lie off its frame's number by the rate."""


def read_lerobot(folder: Path, wanted: Callable[[str], bool], options: ImportOptions) -> Columns:
    """Read an episode: the 1 kHz frames that mmt left beside it, else its rows.

    Of the rows, features (n,) and (n, k) have their own names, and each named component that of
    the feature with its own behind a dot.

    Parameters
    ----------
    folder
        The data set.
    wanted
        Whether a column is read.
    options
        With the episode's number, None for the first; if they map columns, the rows are meant.

    Raises
    ------
    InputError
        pyarrow is not installed, the data set is of another format or not valid, or has no such
        episode.
    """
    origin = f"import {folder}"
    info = _info(folder, origin)
    episodes = info["total_episodes"]
    number = options.episode or 0
    if not 0 <= number < episodes:
        raise InputError(f"{origin}: --episode {number}: its episodes are 0 to {episodes - 1}")
    origin += f", episode {number}"
    notes = []
    if options.episode is None and episodes > 1:
        notes.append(f"this is episode 0 of {episodes}; --episode takes another")
    file = frames_file(folder, number)
    if file.is_file() and not options.columns:
        return replace(read_parquet(file, wanted, options), notes=notes, episode=number)
    return replace(_rows(folder, info, number, wanted, origin), notes=notes, episode=number)


def _info(folder: Path, origin: str) -> dict[str, Any]:
    try:
        info = json.loads((folder / INFO_FILE).read_text(encoding="utf-8"))
        version = str(info["codebase_version"])
        features = {str(name): dict(feature) for name, feature in info["features"].items()}
        found = {"total_episodes": int(info["total_episodes"]), "fps": float(info["fps"])}
        valid = found["total_episodes"] >= 1 and 0 < found["fps"] < float("inf")
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


def _rows(
    folder: Path,
    info: Mapping[str, Any],
    episode: int,
    wanted: Callable[[str], bool],
    origin: str,
) -> Columns:
    features = {
        name: _component_names(feature.get("names"))
        for name, feature in info["features"].items()
        if str(feature.get("dtype")) not in _PICTURES
    }
    columns = {
        f"{name}.{component}": (name, place)
        for name, components in features.items()
        for place, component in enumerate(components)
    }
    needed = {name for name in features if wanted(name)}
    needed |= {name for column, (name, _) in columns.items() if wanted(column)}
    files = sorted((folder / DATA_FOLDER).glob("*/*.parquet"))
    if not files:
        raise InputError(f"{origin}: there is no file in {folder / DATA_FOLDER}")
    read = read_numbers(
        files, needed | {"frame_index", "timestamp"}, origin, [("episode_index", "==", episode)]
    )
    time_s = _times(read["frame_index"], read["timestamp"], info["fps"])
    values: dict[str, FloatArray] = {name: read[name].astype(np.float64) for name in sorted(needed)}
    for column, (name, place) in columns.items():
        if name in needed and wanted(column):
            values[column] = _component(values[name], place, column, origin)
    names = [name for name in (*features, *columns) if name not in OF_EVERY_DATA_SET]
    times = dict.fromkeys((*names, *values), time_s)
    return Columns(origin=origin, values=values, names=names, times=times)


def _times(frame_index: npt.NDArray[Any], timestamp: npt.NDArray[Any], fps: float) -> FloatArray:
    """Return the rows' times (n,), by their numbers where these are meant."""
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
    """Return the names of a feature's components; some writers nest them under what they are."""
    return [re.sub(r"[\[\]]", "_", name) for name in _texts(names)]


def _texts(names: Any) -> Iterator[str]:
    if isinstance(names, str):
        yield names
    elif isinstance(names, list | dict):
        for name in names.values() if isinstance(names, dict) else names:
            yield from _texts(name)
