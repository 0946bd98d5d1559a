"""A motion with its forces and its vibration, and files of every kind that hold columns of it."""

import json

import numpy as np
import pytest
import scipy.io

from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose, try_proposal
from mmt.session.importing.recording import import_recording

TIME_S = np.arange(0.0, 2.0, 0.001)
"""Times of the rows of most files."""


def motion(time_s):
    return np.column_stack([40 * np.sin(4.4 * time_s), 2 * time_s, 5 * np.cos(3 * time_s)])


def force(time_s):
    return np.column_stack([0.3 * np.cos(4.4 * time_s), 0 * time_s, 1.5 + np.sin(1.9 * time_s)])


def vibration(time_s):
    return np.column_stack(
        [2 * np.sin(90 * time_s), 3 * np.cos(70 * time_s), 9.8 + np.sin(80 * time_s)]
    )


TRUTH = {"position": motion, "force": force, "acceleration": vibration}
FIELDS = {"position": "position_mm", "force": "force_n", "acceleration": "acceleration_m_s2"}


def lines(path, head, rows, sign=","):
    """Write a line of names, or several, and rows of cells."""
    path.write_text("\n".join([head, *(sign.join(map(str, row)) for row in rows)]) + "\n", "utf-8")
    return path


def imported(path, **given):
    """Import a file with the options that are proposed for it, and those that are given."""
    proposal, _, error = try_proposal(path, propose(path, ImportOptions(**given)))
    assert error is None, error
    return import_recording(path, proposal.options)[0]


def hdf5(path, **options):
    return pytest.importorskip("h5py", reason="needs the extra 'import'").File(path, "w", **options)


def to_parquet(path, columns, units):
    """Write columns, or lists and structures in them, as a table whose fields tell their units."""
    pa = pytest.importorskip("pyarrow", reason="needs the extra 'export'")
    from pyarrow import parquet

    arrays = {
        n: pa.array(list(c) if isinstance(c, np.ndarray) and (c.ndim > 1 or c.dtype == "O") else c)
        for n, c in columns.items()
    }
    fields = [
        pa.field(n, a.type, metadata={"Units": units[n]} if n in units else None)
        for n, a in arrays.items()
    ]
    parquet.write_table(pa.table(list(arrays.values()), schema=pa.schema(fields)), path)


def to_workbook(path, columns, units):
    book = pytest.importorskip("openpyxl", reason="needs the extra 'import'").Workbook()
    if units:
        book.create_sheet("notes")
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    told = [[units[name] for name in columns]] if units else []
    for row in [["Run 7", 12], list(columns), *told, *rows]:
        book.active.append(row)
    book.save(path)


def to_hdf5(path, columns, units):
    with hdf5(path) as file:
        for name, column in columns.items():
            file[name] = column.astype("S") if column.dtype.kind == "U" else column
            file[name].attrs.update({"UNIT": units[name]} if name in units else {})


def to_tdms(path, columns, units):
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        objects = (
            nptdms.ChannelObject("run", name, column, {"unit_string": units[name]})
            for name, column in columns.items()
        )
        writer.write_segment(list(objects))


def to_json_lines(path, columns):
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    objects = ({"run": dict(zip(columns, row, strict=True))} for row in rows)
    path.write_text("\n".join(map(json.dumps, objects)))


def to_array(path, columns):
    kinds = [(name, column.dtype.str) for name, column in columns.items()]
    np.save(path, np.array(list(zip(*columns.values(), strict=True)), dtype=kinds))


def to_matlab(path, columns):
    texts = {n: c.astype(object) if c.dtype.kind == "U" else c for n, c in columns.items()}
    scipy.io.savemat(path, {"run": texts, "note": "rough wood"})


def to_json(path, columns):
    path.write_text(json.dumps({"run": {name: c.tolist() for name, c in columns.items()}}))


WRITERS = {
    "csv": lambda path, columns: lines(
        path, ",".join(columns), zip(*columns.values(), strict=True)
    ),
    "json": to_json,
    "jsonl": to_json_lines,
    "npz": lambda path, columns: np.savez(path, **columns),
    "npy": to_array,
    "mat": to_matlab,
    "h5": to_hdf5,
    "xlsx": to_workbook,
    "parquet": to_parquet,
    "tdms": to_tdms,
}
TELLING = ("h5", "xlsx", "parquet", "tdms")
"""Kinds that tell units apart from names."""


def write_columns(path, columns, units=None):
    """Write columns by name as a file of the path's kind; return the names that they have in it.

    Their units, if any, are told apart or at the ends of the names, as it is with this kind.
    """
    kind, units = path.suffix[1:], units or {}
    if kind in TELLING:
        WRITERS[kind](path, columns, units)
        return {name: name for name in columns}
    names = {name: f"{name}_{units[name]}" if name in units else name for name in columns}
    WRITERS[kind](path, {names[name]: column for name, column in columns.items()})
    within = "run." if kind in ("json", "jsonl", "mat") else ""
    return {name: f"{within}{told}" for name, told in names.items()}
