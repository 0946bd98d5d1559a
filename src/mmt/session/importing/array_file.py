"""NumPy archives, and what belongs to a session in those that mmt wrote."""

import json
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.session.importing.columns import Columns

_DAMAGE = (
    *(ValueError, EOFError, zipfile.BadZipFile, zlib.error),
    MemoryError,  # a shape that is larger than the machine
    NotImplementedError,  # a compression that Python does not know
    RuntimeError,  # an encrypted member
)
"""What reading an archive raises where it is damaged, or not made by NumPy."""

_OF_THE_SESSION = ("scene_json", "annotations", "events_json")


def read_archive(path: Path, wanted: Callable[[str], bool]) -> Columns:
    """Read the wanted arrays of a ``.npz``, with scene, annotations and events of a session.

    Raises
    ------
    InputError
        The file is missing or not an archive, or an array does not hold numbers.
    """
    origin = f"import {path}"
    arrays, names = _load(path, wanted)
    events = _json(arrays, "events_json", origin)
    return Columns(
        origin=origin,
        values={n: _numbers(a, n, origin) for n, a in arrays.items() if n not in _OF_THE_SESSION},
        names=names,
        scene=_json(arrays, "scene_json", origin),
        annotations=arrays["annotations"].tobytes() if "annotations" in arrays else b"",
        events=events or (),
    )


def _load(
    path: Path, wanted: Callable[[str], bool]
) -> tuple[dict[str, np.ndarray[Any, np.dtype[Any]]], list[str]]:
    try:
        loaded = np.load(path, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            raise InputError(f"import {path}: this is a single array, not a .npz archive")
        with loaded as archive:
            names = [name for name in archive.files if wanted(name) or name in _OF_THE_SESSION]
            return {name: archive[name] for name in names}, list(archive.files)
    except OSError as error:
        raise InputError(f"import {path}: {error.strerror or error}") from error
    except _DAMAGE as error:
        raise InputError(
            f"import {path}: this is not a .npz archive of numbers: {error}"
        ) from error


def _numbers(array: Any, name: str, origin: str) -> FloatArray:
    try:
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{origin}: {name} does not hold numbers: {error}") from error


def _json(arrays: Mapping[str, Any], name: str, origin: str) -> Any:
    if name not in arrays:
        return None
    try:
        return json.loads(str(arrays[name]))
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{origin}: {name} is not valid JSON: {error}") from error
