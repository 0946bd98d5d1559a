"""Read arrays from NumPy files, including exported sessions, and from sound files."""

import io
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.files.untrusted import load_arrays
from mmt.core.frames import FRAMES_HZ, MOST_SAMPLES
from mmt.session.data import FRAME_PERIOD_NS, frames_of
from mmt.session.export_files import read_comment
from mmt.session.importing.columns import (
    BEGAN,
    OF_THE_SESSION,
    SourceColumns,
    beside_columns,
    parsed_date,
    reading,
)
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import columns_of, numbers_in


def read_archive(
    path: Path, wanted: Callable[[str], bool], _options: ImportOptions
) -> SourceColumns:
    """Read the wanted arrays of a ``.npz``, with scene, annotations and events of a session.

    The fields of an array are columns, as ``array.field``.

    Raises
    ------
    InputError
        The file is missing or not an archive, an array does not hold numbers, or the session's
        scene or events are not valid.
    """
    with reading("an .npz archive"):
        every = {n: list(_columns(n, np.zeros(0, kind))) for n, kind in _kinds(path).items()}
        asked = {name for name, columns in every.items() if any(map(wanted, columns))}
        arrays, names = load_arrays(path, lambda n: n in {*OF_THE_SESSION, *asked} or wanted(n))
    plain = {name: array for name, array in arrays.items() if name not in OF_THE_SESSION}
    columns = {n: c for name, array in plain.items() for n, c in _columns(name, array).items()}
    return SourceColumns(
        names=[column for name in names for column in every.get(name, [name])],
        **columns_of({n: c for n, c in columns.items() if wanted(n)}),
        **beside_columns(arrays),
    )


def _kinds(path: Path) -> dict[str, Any]:
    """Return the types of the arrays in an archive that have fields, without reading these."""
    form, kinds = np.lib.format, dict[str, Any]()
    readers = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}
    with suppress(zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            with suppress(ValueError, KeyError, RuntimeError), archive.open(name) as member:
                kind = readers[form.read_magic(member)](member)[2]
                kinds |= {name.removesuffix(".npy"): kind} if kind.names else {}
    return kinds


def _columns(name: str, array: Any) -> dict[str, Any]:
    """Return the fields of an array of that name, or the array."""
    return dict(_members(array, f"{name}.")) if array.dtype.names else {name: array}


def read_array(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> SourceColumns:
    """Read the wanted columns of a ``.npy``: its fields, or columns "1", "2", ... of shape (n, k).

    Raises
    ------
    InputError
        The file is missing, or not an array of numbers.
    """
    with reading("a .npy array"):
        array = np.load(path, allow_pickle=False)
    if not isinstance(array, np.ndarray) or array.ndim > 2:
        raise InputError("this is not an array of shape (n,) or (n, k)")
    fields = array.dtype.names is not None
    columns = dict(_members(array)) if fields else _numbered(numbers_in(array, "it")[0])
    read = columns_of({n: a for n, a in columns.items() if wanted(n)})
    return SourceColumns(names=list(columns), **read)


def read_sound(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> SourceColumns:
    """Read the channels of a ``.wav`` as "1", "2", ..., in the unit "full scale", with times.

    An exported session has its full scale in the file and gives ``acceleration_m_s2`` too.

    Raises
    ------
    InputError
        scipy is not installed, or the file is missing or not valid.
    """
    require("scipy")
    from scipy.io import wavfile

    with reading("a .wav file"), warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always")
        rate_hz, samples = wavfile.read(path)
        if not len(samples):
            rate_hz, samples = wavfile.read(_completed(path.read_bytes()))
        told = read_comment(path)
    cut = any("EOF" in str(each.message) for each in odd)  # others: chunks of other programs
    scaled = samples.astype(np.float64)
    if samples.dtype.kind in "iu":
        middle = 128.0 if samples.dtype == np.uint8 else 0.0
        scaled = (scaled - middle) / (np.iinfo(samples.dtype).max + 1.0 - middle)
    columns = _numbered(scaled)
    units = dict.fromkeys(columns, "full scale")
    full_scale, frames = told.get("full_scale_m_s2"), None
    if isinstance(full_scale, float) and scaled.ndim == 2 and scaled.shape[1] == 3:
        columns["acceleration_m_s2"] = full_scale * scaled
        frames = _frames(columns["acceleration_m_s2"], rate_hz)
    return SourceColumns(
        values={name: values for name, values in columns.items() if wanted(name)},
        names=list(columns),
        units=units,
        times=dict.fromkeys(columns, np.arange(len(scaled)) / rate_hz),
        frames=frames,
        notes=["the file ends before its header says: it was read as far as it goes"]
        if cut
        else [],
        began_utc_ns=parsed_date(told.get(BEGAN)),
    )


def _completed(content: bytes) -> io.BytesIO:
    """Return a sound whose length was not written, as of a recorder that died, with it."""
    head, found, data = content.partition(b"data\0\0\0\0")
    frame = int.from_bytes(head[head.find(b"fmt ") + 20 :][:2], "little") or 1
    size = len(data) // frame * frame
    whole = head + b"data" + size.to_bytes(4, "little") + data[:size]
    empty = int.from_bytes(data[4:8], "little") == len(data) - 8  # a chunk follows, and ends it
    return io.BytesIO(whole if found and not empty else content)


def _frames(acceleration_m_s2: FloatArray, rate_hz: int) -> RecordArray | None:
    """Return samples (n, 3) as frames, or None if their rate is not a possible one of frames."""
    several, rest = divmod(rate_hz, FRAMES_HZ)
    if rest or not 1 <= several <= MOST_SAMPLES:
        return None
    count = len(acceleration_m_s2) // several
    numbers, values = np.arange(count), acceleration_m_s2[: count * several]
    return frames_of(numbers, numbers * FRAME_PERIOD_NS, {"acceleration": values}, several)


def _members(array: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the fields of an array, also those within fields, as ``field.member``."""
    for name in array.dtype.names:
        if array.dtype[name].names:
            yield from _members(array[name], f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", array[name]


def _numbered(array: Any) -> dict[str, Any]:
    return {str(place): column for place, column in enumerate(np.atleast_2d(array.T), start=1)}
