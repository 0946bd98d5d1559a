"""NumPy archives, and what belongs to a session in those that mmt wrote."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.archives import load_arrays
from mmt.core.arrays import FloatArray
from mmt.core.errors import InputError
from mmt.session.importing.columns import Columns, parsed_events, parsed_scene
from mmt.session.importing.options import ImportOptions

_OF_THE_SESSION = ("scene_json", "annotations", "events_json")


def read_archive(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> Columns:
    """Read the wanted arrays of a ``.npz``, with scene, annotations and events of a session.

    Raises
    ------
    InputError
        The file is missing or not an archive, an array does not hold numbers, or the session's
        scene or events are not JSON of such.
    """
    origin = f"import {path}"
    try:
        arrays, names = load_arrays(path, lambda name: name in _OF_THE_SESSION or wanted(name))
    except OSError as error:
        raise InputError(f"{origin}: {error.strerror or error}") from error
    except InputError as error:
        raise InputError(f"{origin}: {error}") from error
    scene, events = (
        str(arrays[name]) if name in arrays else None for name in ("scene_json", "events_json")
    )
    return Columns(
        origin=origin,
        values={n: _numbers(a, n, origin) for n, a in arrays.items() if n not in _OF_THE_SESSION},
        names=names,
        scene=parsed_scene(scene, "scene_json", origin),
        annotations=arrays["annotations"].tobytes() if "annotations" in arrays else b"",
        events=parsed_events(events, "events_json", origin),
    )


def _numbers(array: Any, name: str, origin: str) -> FloatArray:
    try:
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{origin}: {name} does not hold numbers: {error}") from error
