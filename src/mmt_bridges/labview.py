"""TDMS files, as LabVIEW and other programs for boards by National Instruments write them."""

import os
import re
import struct
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from mmt.core.arrays import FloatArray
from mmt.core.extras import require
from mmt.session.importing.columns import SourceColumns, distinct, reading, told_unit
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.readers.cells import columns_of

_PERIOD: Final = "wf_increment"
_BEGIN: Final = "wf_start_time"
_STATED: Final = re.compile(_BEGIN.encode() + rb"....(.{16})", re.DOTALL)
"""A start in a segment's metadata: the property's name, its type, and the time."""
_LEAD_BYTES: Final = 28
_BIG_ENDIAN: Final = 0x40
_SCALES: Final = frozenset(("Linear", "Polynomial", "Table", "Add", "Subtract", "AdvancedAPI")) | {
    "RTD",
    "Strain",
    "Thermistor",
    "Thermocouple",
}
"""Kinds of scales that npTDMS applies; with one of another kind it returns the raw values."""
_NO_DATE: Final = np.datetime64("1904-01-01T01", "ns")
"""LabVIEW's dates count from 1904: one in its first hour was never set."""


def read_tdms(path: Path, wanted: Callable[[str], bool], _options: ImportOptions) -> SourceColumns:
    """Read the wanted channels (n,) of a TDMS file, and the times of those that are waveforms.

    A channel's column has its name, or ``GROUP.NAME`` if the file has several groups.

    Raises
    ------
    InputError
        npTDMS is not installed, the file is missing or not TDMS, or a wanted channel does not hold
        numbers.
    """
    require("nptdms")
    import nptdms

    with (
        reading("a TDMS file"),
        path.open("rb") as stream,
        nptdms.TdmsFile.open(stream) as file,
    ):
        found = [channel for group in file.groups() for channel in group.channels() if len(channel)]
        several = len({channel.group_name for channel in found}) > 1
        names, notes = distinct([f"{c.group_name}.{c.name}" if several else c.name for c in found])
        channels = dict(zip(names, found, strict=True))
        waves = {name: c for name, c in channels.items() if c.properties.get(_PERIOD, 0.0) > 0.0}
        parts = [*_parts(stream), file]
        pieces = {name: _in_parts(channel, parts) for name, channel in waves.items()}
        begins = (_begin(piece.properties) for of_one in pieces.values() for piece in of_one)
        first = min((begin for begin in begins if begin is not None), default=None)
        return SourceColumns(
            names=names,
            times={name: _times_s(pieces[name], first) for name in waves},
            notes=notes,
            began_utc_ns=None if first is None else int(first.astype(np.int64)),
            **columns_of(
                {name: channel[:] for name, channel in channels.items() if wanted(name)},
                {name: _unit(file, channel) for name, channel in channels.items()},
            ),
        )


def _unit(file: Any, channel: Any) -> str:
    """Return the unit of a channel's values: raw ones if its scale is of an unknown kind."""
    for holder in (channel, file[channel.group_name], file):  # the nearest with scales counts
        scales = {v for k, v in holder.properties.items() if k.endswith("_Scale_Type")}
        if scales and holder.properties.get("NI_Scaling_Status") != "scaled":
            unknown = ", ".join(sorted(scales - _SCALES))
            if unknown:
                return f"raw values, its scale is of an unknown kind: {unknown}"
            break
    return told_unit(channel.properties)


def _begin(properties: Mapping[str, Any]) -> "np.datetime64 | None":
    begin = properties.get(_BEGIN)
    if not isinstance(begin, np.datetime64) or begin < _NO_DATE:
        return None
    nanoseconds: np.datetime64 = begin.astype("datetime64[ns]")
    return nanoseconds


def _parts(stream: BinaryIO) -> list[Any]:
    """Read the metadata up to the end of each acquisition but the last.

    An acquisition that is appended to a file states its start in its first segment. Of what is
    stated again npTDMS keeps the last, so it reads the metadata once for each.
    """
    import nptdms

    index, ends = bytearray(), list[int]()
    last: list[bytes] = []
    file_bytes = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    while len(lead := stream.read(_LEAD_BYTES)) == _LEAD_BYTES:
        order = ">" if lead[4] & _BIG_ENDIAN else "<"
        segment_bytes, metadata_bytes = struct.unpack_from(f"{order}2Q", lead, 12)
        metadata = stream.read(min(segment_bytes, metadata_bytes))
        stated = _STATED.findall(metadata) or last
        if index and stated != last:
            ends.append(len(index))
        last = stated
        index += b"TDSh" + lead[4:] + metadata
        stream.seek(min(segment_bytes, file_bytes) - len(metadata), os.SEEK_CUR)
    return [nptdms.TdmsFile.read_metadata(BytesIO(index[:end])) for end in ends]


def _in_parts(channel: Any, parts: list[Any]) -> list[Any]:
    """Return what each part of the file says of a channel, of those in which it is."""
    group, name = channel.group_name, channel.name
    return [part[group][name] for part in parts if group in part and name in part[group]]


def _times_s(pieces: list[Any], first: "np.datetime64 | None") -> FloatArray:
    """Return the times (n,) of a waveform's samples, in s since the first waveform's beginning."""
    times: list[FloatArray] = []
    before = 0
    for piece in pieces:
        offset_s = float(piece.properties.get("wf_start_offset", 0.0))
        begin = _begin(piece.properties)
        if begin is not None and first is not None:
            offset_s += float((begin - first) / np.timedelta64(1, "s"))
        period_s = float(piece.properties.get(_PERIOD, pieces[-1].properties[_PERIOD]))
        times.append(offset_s + period_s * np.arange(len(piece) - before, dtype=np.float64))
        before = len(piece)
    return np.concatenate(times)
