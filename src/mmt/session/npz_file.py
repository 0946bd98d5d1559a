"""Sessions as NumPy archives: the arrays of `mmt session import`."""

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, FIELD_OF_CHANNEL
from mmt.session.data import RecordedSession, to_json
from mmt.session.files import replacing
from mmt.session.resampling import to_frames
from mmt.session.samples import Samples

_DAMAGE = (
    *(ValueError, EOFError, zipfile.BadZipFile, zlib.error),
    MemoryError,  # a shape that is larger than the machine
    NotImplementedError,  # a compression that Python does not know
    RuntimeError,  # an encrypted member
)
"""What reading an archive raises where it is damaged, or not made by NumPy."""


def read_npz(path: Path, longest_gap_s: float | None = None) -> RecordedSession:
    """Read a recording; see `mmt.session.import_session`.

    An archive that `write_npz` made gives back its frames unchanged (their times from
    zero), with scene, annotations and events.

    Raises
    ------
    InputError
        The file is missing or not an archive, or an array is missing or not valid.
    """
    arrays = _load(path)
    origin = f"import {path}"
    samples = Samples(
        origin=origin,
        time_s=_column(arrays, "time_s", origin),
        values={c: _vectors(arrays, f, origin) for c, f in FIELD_OF_CHANNEL.items() if f in arrays},
        acceleration_time_s=_optional(arrays, "acceleration_time_s", origin),
        sequence=_optional(arrays, "sequence", origin),
    )
    return RecordedSession(
        frames=to_frames(samples, longest_gap_s),
        scene=_json(arrays, "scene_json", origin),
        annotations=arrays["annotations"].tobytes() if "annotations" in arrays else b"",
        events=_json(arrays, "events_json", origin) or (),
        path=path,
    )


def write_npz(path: Path, session: RecordedSession) -> None:
    """Write frames, scene, annotations and events.

    Raises
    ------
    InputError, MmtError
        See `mmt.session.export_session`.
    """
    frames = session.frames
    arrays: dict[str, Any] = {"sequence": frames["sequence"], "time_s": session.time_s}
    for channel in CHANNELS:
        if channel in session.channels:
            arrays[FIELD_OF_CHANNEL[channel]] = frames[FIELD_OF_CHANNEL[channel]]
    if session.scene is not None:
        arrays["scene_json"] = np.array(to_json(dict(session.scene)))
    if session.annotations:
        arrays["annotations"] = np.frombuffer(session.annotations, dtype=np.uint8)
    if session.events:
        arrays["events_json"] = np.array(to_json([dict(event) for event in session.events]))
    with replacing(path) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def _load(path: Path) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
    try:
        loaded = np.load(path, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            raise InputError(f"import {path}: this is a single array, not a .npz archive")
        with loaded as archive:
            return {name: archive[name] for name in archive.files}
    except OSError as error:
        raise InputError(f"import {path}: {error.strerror or error}") from error
    except _DAMAGE as error:
        raise InputError(
            f"import {path}: this is not a .npz archive of numbers: {error}"
        ) from error


def _numbers(arrays: Mapping[str, Any], name: str, origin: str) -> FloatArray:
    try:
        return np.asarray(arrays[name], dtype=np.float64)
    except KeyError as error:
        held = ", ".join(arrays) or "nothing"
        raise InputError(f"{origin}: the array {name} is missing; the file holds {held}") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"{origin}: {name} does not hold numbers: {error}") from error


def _column(arrays: Mapping[str, Any], name: str, origin: str) -> FloatArray:
    values = _numbers(arrays, name, origin)
    if values.ndim != 1:
        raise InputError(f"{origin}: {name} has shape {values.shape}, it must have shape (n,)")
    return values


def _optional(arrays: Mapping[str, Any], name: str, origin: str) -> FloatArray | None:
    return _column(arrays, name, origin) if name in arrays else None


def _vectors(arrays: Mapping[str, Any], name: str, origin: str) -> FloatArray:
    values = _numbers(arrays, name, origin)
    if values.ndim != 2 or values.shape[1] != 3:
        raise InputError(f"{origin}: {name} has shape {values.shape}, it must have shape (n, 3)")
    return values


def _json(arrays: Mapping[str, Any], name: str, origin: str) -> Any:
    if name not in arrays:
        return None
    try:
        return json.loads(str(arrays[name]))
    except (json.JSONDecodeError, RecursionError) as error:
        raise InputError(f"{origin}: {name} is not valid JSON: {error}") from error
