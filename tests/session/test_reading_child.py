"""Files of foreign formats are read in a child, which may take so much memory and time."""

import gzip
import os
import resource
import signal
import struct
import subprocess
import zipfile
import zlib
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_runs import output_of, refusal
from plugin_samples import install_package
from recording_files import write_columns
from session_samples import made_frames
from waiting import PATIENCE_S, children, until

from mmt.core.errors import InputError
from mmt.core.running.programs import import_path, python_command
from mmt.session.data import RecordedSession
from mmt.session.files import export_session, import_session, read_session
from mmt.session.formats import GROUP
from mmt.session.importing.columns import wanted_names
from mmt.session.importing.options import ImportOptions
from mmt.session.importing.proposal import propose
from mmt.session.importing.reading_child import reads_here
from mmt.session.importing.recording import read_columns

BLOCK = bytes(1 << 20)
FEW_MB = 250.0
TOLD = r"reading it may take .* GB of memory and .* s \(--reading-memory GB and --reading-time S al"


def filled(path):
    """Write a data set of 9.6 GB that has nothing stored but the value that fills it."""
    with h5py.File(path, "w", userblock_size=512) as file:
        shape = {"shape": (1, 1_200_000_000), "chunks": (1, 1 << 20)}
        file.create_dataset("time_s", dtype="f8", fillvalue=1.0, **shape)
    with path.open("r+b") as file:  # HDF5 does not look at what is before it
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def zeros(path):
    """Write a MATLAB file of 300 MB of zeros, packed."""
    count = 300 * len(BLOCK) // 8
    parts = [struct.pack("<IIII", 6, 8, 6, 0), struct.pack("<IIii", 5, 8, count, 1)]
    parts += [struct.pack("<II8s", 1, 6, b"time_s"), struct.pack("<II", 9, 8 * count)]
    head = b"".join(parts)
    packer = zlib.compressobj(1)
    packed = packer.compress(struct.pack("<II", 14, len(head) + 8 * count) + head)
    packed += b"".join(packer.compress(BLOCK) for _ in range(300)) + packer.flush()
    begin = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(begin + struct.pack("<II", 15, len(packed)) + packed)


def long_text(path):
    """Write a workbook with a text of 200 MB."""
    book = openpyxl.Workbook()
    book.active.append(["time_s", 1.0])
    book.save(path.with_suffix(".plain"))
    with (
        zipfile.ZipFile(path.with_suffix(".plain")) as plain,
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as made,
    ):
        for name in plain.namelist():
            text = plain.read(name)
            with made.open(name, "w") as member:
                begin, end, rest = text.partition(b"time_s")
                member.write(begin + end)
                for _ in range(200 if end else 0):
                    member.write(BLOCK.replace(b"\0", b"a"))
                member.write(rest)


def run_lengths(path):
    """Write 30 million equal values."""
    bits = pa.Array.from_buffers(pa.bool_(), 30_000_000, [None, pa.py_buffer(bytes(3_750_000))])
    pq.write_table(pa.table({"time_s": bits}), path)


def many_lines(path):
    with gzip.open(path, "wb", compresslevel=1) as file:
        for _ in range(50):
            file.write(b"1,1\n" * (1 << 18))


def peak_mb(who):
    return resource.getrusage(who).ru_maxrss * 1024 / 1e6


@pytest.mark.parametrize(
    ("name", "make", "time_s", "what"),
    [
        ("filled.h5", filled, PATIENCE_S, "memory"),
        ("filled.mat", filled, PATIENCE_S, "memory"),
        ("zeros.mat", zeros, PATIENCE_S, "memory"),
        ("long.xlsx", long_text, PATIENCE_S, "memory"),
        ("runs.parquet", run_lengths, PATIENCE_S, "memory"),
        ("lines.csv.gz", many_lines, 3.0, "time"),
    ],
)
def test_a_small_file_that_takes_much_is_refused(tmp_path, name, make, time_s, what):
    path = tmp_path / name
    make(path)
    assert path.stat().st_size < 25 << 20
    here_mb, before_mb = peak_mb(resource.RUSAGE_SELF), peak_mb(resource.RUSAGE_CHILDREN)
    told = rf"^import \S*{name}: it took more {what} than it may; {TOLD}"
    with pytest.raises(InputError, match=told):
        import_session(path, reading_memory_gb=FEW_MB / 1e3, reading_time_s=time_s)
    assert peak_mb(resource.RUSAGE_SELF) < here_mb + 100
    # a forked process begins with the peak of its parent
    assert peak_mb(resource.RUSAGE_CHILDREN) < max(before_mb, here_mb, FEW_MB) + 200


@pytest.mark.parametrize(
    "command",
    ["session inspect FILE", "session import FILE a.mcap", "session info FILE",
     "session export FILE a.mcap", "evaluate FILE", "model build FILE a.npz", "model select FILE",
     "try FILE"],
)  # fmt: skip
def test_every_command_refuses_it(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    filled(Path("filled.h5"))
    said = refusal(*command.replace("FILE", "filled.h5").split())
    assert said.startswith("import filled.h5: it took more memory than it may; reading it may take")
    assert " 2 GB of memory and 60 s (--reading-memory GB and --reading-time S allow more)" in said


def test_the_library_refuses_it_too(tmp_path):
    filled(tmp_path / "filled.h5")
    with pytest.raises(InputError, match=f"{TOLD}.*import it first: mmt session import"):
        read_session(tmp_path / "filled.h5")


def same(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.tobytes() == other.tobytes()
    return bool(one == other)


@pytest.mark.parametrize("name", ["a.h5", "a.mat", "a.parquet", "a.xlsx", "bag"])
def test_rows_are_those_that_this_process_would_read(tmp_path, name):
    path, options = tmp_path / name, ImportOptions(columns={"force_z": "force_z"})
    session = RecordedSession(made_frames(500), events=[{"time_s": 0.1}], began_utc_ns=10**18)
    if name == "a.xlsx":
        columns = {"time_s": session.time_s, "force_z [mN]": session.frames["force_n"][:, 2]}
        write_columns(path, columns)
    else:
        export_session(session, path)
    wanted = wanted_names(options)
    read = read_columns(path, wanted, options)
    reads_here.set()
    try:
        here = read_columns(path, wanted, options)
    finally:
        reads_here.clear()
    assert read.values
    for each in fields(here):
        if each.name != "row_name":
            assert same(getattr(read, each.name), getattr(here, each.name)), each.name
    assert read.row_name(3) == here.row_name(3)


PLUGIN = """
import logging, os, signal, time, warnings
import numpy as np
from mmt.core.errors import InputError
from mmt.session.importing.columns import SourceColumns

def read(path, wanted, options):
    warnings.warn("a warning of the library", RuntimeWarning)
    logging.getLogger("library").warning("a line of its log")
    eval(path.read_text())
    return SourceColumns({}, names=["a", str(os.getpid())])

def refuse():
    raise InputError("no such column")
"""


@pytest.fixture
def behaving(tmp_path, monkeypatch):
    """A file whose text is what its reader, a stranger's, does."""
    name = f"reader_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(PLUGIN)
    install_package(tmp_path, monkeypatch, name, {GROUP: {"import.odd": f"{name}:read"}})
    path = tmp_path / "a.odd"
    path.write_text("print('not an answer', flush=True)")
    return path


def test_log_and_warnings_are_those_of_this_process(behaving, caplog):
    with pytest.warns(RuntimeWarning, match="a warning of the library"):
        names = read_columns(behaving, wanted_names(ImportOptions())).names
    assert names[0] == "a"
    assert names[1] != str(os.getpid())
    assert [(r.name, r.message) for r in caplog.records] == [("library", "a line of its log")]


@pytest.mark.filterwarnings("ignore:a warning of the library")
@pytest.mark.parametrize(
    ("does", "error", "told"),
    [
        ("refuse()", InputError, "a.odd: no such column$"),
        ("1 / 0", RuntimeError, "ZeroDivisionError: division by zero"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", InputError, f"ended by SIGSEGV, .*; {TOLD}"),
        ("os._exit(4)", InputError, f"ended with code 4, as on a damaged file; {TOLD}"),
        (
            "os.write(2, b'corrupt heap\\n') and os.abort()",
            InputError,
            r"SIGABRT \(corrupt heap\), as",
        ),
        ("np.full(1 << 30, 1.0)", InputError, f"a.odd: it took more memory than it may; {TOLD}"),
        ("time.sleep(60)", InputError, "took more time .* may take 0.5 GB of memory and 2 s"),
    ],
)
def test_how_a_reader_ends_is_told(behaving, does, error, told):
    behaving.write_text(does)
    time_s = 2.0 if "sleep" in does else PATIENCE_S
    options = ImportOptions(reading_memory_gb=0.5, reading_time_s=time_s)
    with pytest.raises(error, match=told):
        read_columns(behaving, wanted_names(options), options)
    assert not children("reading_child")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_child_stays_behind(behaving, number):
    behaving.write_text("time.sleep(60)")
    command = python_command("-m", "mmt.cli.entry", "main", "session", "inspect", str(behaving))
    with subprocess.Popen(
        [*command], env={**os.environ, "PYTHONPATH": import_path()}, stderr=subprocess.PIPE
    ) as process:
        until(lambda: children("reading_child", process.pid))
        (child,) = children("reading_child", process.pid)
        process.send_signal(number)
        said = process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == (-number if number == signal.SIGKILL else 130)
    assert said == (b"" if number == signal.SIGKILL else b"stopped\n")
    psutil.wait_procs([child], timeout=PATIENCE_S)
    assert not child.is_running()


def test_the_limits_can_be_set_and_are_proposed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    export_session(RecordedSession(made_frames(2000)), "a.h5")
    given = ["--reading-memory=1.5", "--reading-time=90.0"]
    proposed = output_of("session", "inspect", "a.h5", *given).splitlines()[-1]
    assert proposed == f"mmt session import a.h5 a.mcap {' '.join(given)}"
    said = refusal("session", "import", "a.h5", "a.mcap", "--reading-memory", "0.02")
    assert "may take 0.02 GB" in said
    assert len(import_session("a.h5", reading_memory_gb=1.0, reading_time_s=90).frames) == 2000
    with pytest.raises(InputError, match=r"reading_time_s is -1, allowed is .* above 0"):
        propose("a.h5", ImportOptions(reading_time_s=-1))
