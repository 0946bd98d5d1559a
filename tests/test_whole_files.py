"""Files are written whole or not at all, and an end of descriptors ends in a sentence."""

import ast
import os
import resource
import subprocess
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from frame_samples import made_frames
from sharing_samples import model_of

import mmt
from mmt.cli.common import write_json
from mmt.core.errors import InputError, MmtError
from mmt.core.files.existing import append_lines, write_file
from mmt.devices.calibrations import save_calibration
from mmt.evaluation.reports.report_files import write_report_files
from mmt.session.data import RecordedSession
from mmt.session.files import export_session
from mmt_bridges.haptics.ahap import write_ahap
from mmt_bridges.haptics.effects import write_wav
from mmt_bridges.haptics.hjif import write_hjif
from mmt_share.player.results import COLUMNS, ResultsFile

SESSION = RecordedSession(made_frames(0, 4000))
VIBRATION = np.random.default_rng(1).standard_normal(40_000)


def save_coil(path):
    with mock.patch("mmt.devices.calibrations.calibration_file", return_value=path):
        save_calibration("coil", "7", {"a": "b" * 9000})


KINDS = {
    **{
        f"a{suffix}": lambda path: export_session(SESSION, path)
        for suffix in (".mcap", ".npz", ".csv", ".parquet", ".h5")
    },
    "m.npz": lambda path: model_of(60).save(path),
    "m.wav": lambda path: write_wav(path, VIBRATION, 8000),
    "m.hjif": lambda path: write_hjif(path, VIBRATION[:8000], 8000),
    "m.ahap": lambda path: write_ahap(path, VIBRATION, 1000),
    "figures.json": lambda path: write_json(path, list(range(2000))),
    "report.html": lambda path: write_report_files(
        path.parent, "x", [], "d.json", {"a": "b" * 9999}
    ),
    "results.csv": lambda path: ResultsFile(path).write(dict.fromkeys(COLUMNS, "x" * 500)),
    "coil-7.json": save_coil,
}
NOT_PRODUCTS = {
    "mmt/core/files/existing.py",  # the helper
    "mmt/session/recorder.py",  # grows as long as the session lasts, and is read when cut off
    "mmt/core/compiled.py",  # caches, and files of the kernel and of drivers
    "mmt/core/running/process.py",
    "mmt_devices/iio/attributes.py",
    "mmt_devices/iio/emulated.py",
    "mmt/cli/scene/runs.py",  # in folders for the moment
    "mmt_bridges/ros/storage.py",
    "mmt_bridges/lerobot/dataset.py",  # in a folder that is replaced as one
}


@pytest.mark.skipif(sys.platform == "win32", reason="has no limit of file sizes")
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("room_bytes", [0, 1000])
def test_what_finds_no_room_leaves_the_folder_as_it_was(name, room_bytes, tmp_path):
    path, write = tmp_path / name, KINDS[name]
    (tmp_path / "before").mkdir()
    write(tmp_path / "before" / name)  # imports all, as cached code would be cut off too
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    header = ",".join(COLUMNS).encode() + b"\n"
    for before in (None, header):
        if before is not None:
            path.write_bytes(before)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room_bytes, limits[1]))
        try:
            with pytest.raises(MmtError) as raised:
                write(path)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert raised.value.exit_code == 1
        assert (path.read_bytes() if path.exists() else None) == before
        beside = {each.name for each in tmp_path.iterdir()} - {name}
        assert beside <= {"figures", "report.md", "before"}
    write(path)
    assert path.stat().st_size > 1000


def test_a_link_and_a_device_stay_what_they_are(tmp_path):
    kept, link = tmp_path / "kept.json", tmp_path / "link.json"
    kept.write_text("before")
    kept.chmod(0o640)
    link.symlink_to(kept)
    write_file(link, "after")
    assert link.is_symlink()
    assert (kept.read_text(), kept.stat().st_mode & 0o777) == ("after", 0o640)
    write_json(Path("/dev/null"), {})
    assert Path("/dev/null").is_char_device()
    if Path("/dev/full").exists():
        with pytest.raises(MmtError, match="writing /dev/full failed: No space left"):
            write_json(Path("/dev/full"), {})
    with pytest.raises(InputError, match="cannot write"):
        model_of(10).save(tmp_path / "nowhere" / "oak.npz")


def test_lines_at_the_end_are_there_with_one_header(tmp_path):
    path = tmp_path / "new" / "lines.txt"
    for line in ("a\n", "ü\n", "b\n"):
        append_lines(path, line, header="head\n")
        path.write_bytes(path.read_bytes().removesuffix(b"\xbc\n"))  # a line that is cut off
    assert path.read_bytes() == b"head\na\n\xc3\nb\n"


def test_no_module_writes_a_file_by_itself():
    """A file opened for writing is one that `replacing` gave, which is called ``part``."""
    source, found = Path(mmt.__file__).parents[1], []
    for path in sorted(source.glob("mmt*/**/*.py")):
        place = path.relative_to(source).as_posix()
        if place in NOT_PRODUCTS or place.startswith(("mmt/testing/", "mmt_lab/")):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                first = next(iter(node.args), None)
                mode = str(first.value) if isinstance(first, ast.Constant) else ""
                writes = node.func.attr in {"write_bytes", "write_text"}
                writes |= node.func.attr == "open" and mode.strip("bt+") in {"w", "x", "a"}
                if writes and ast.unparse(node.func.value) != "part":
                    found.append(f"{place}:{node.lineno}")
    assert found == []


@pytest.mark.skipif(sys.platform == "win32", reason="has no such limit")
def test_too_few_descriptors_end_in_a_sentence():
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_NOFILE, (12, 12)); "
        "sys.argv[1:] = ['scene', 'explain', 'demo', '--measure']; "
        "from mmt.cli.entry import mmt; mmt()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", limited], capture_output=True, text=True, timeout=120, check=False
    )
    assert ended.returncode == 1
    assert "error: too many files are open: raise the limit" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_path_whose_bytes_are_no_text_is_escaped_in_a_text(tmp_path):
    write_file(tmp_path / "text", os.fsdecode(b"stra\xdfe"))
    assert (tmp_path / "text").read_text(encoding="utf-8") == r"stra\udcdfe"
