"""Files of the folder in which a command is run take the place of no module of its processes."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from service_processes import LONGEST_S, Service

import mmt
from mmt.core.running.programs import import_path, python_command

SOURCES = Path(mmt.__file__).parent.parent
ALLOWED = {
    "sys.executable": {
        "mmt/core/running/programs.py",
        "mmt/core/extras.py",
        "mmt/cli/running/display.py",
    },
    "get_context": {"mmt_lab/harness/processes.py"},
}
"""Files that may name what starts a process; one has a command for a person."""


@pytest.fixture
def hostile(tmp_path, monkeypatch):
    """A folder with a file for each module of the standard library, and for some others."""
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    names = {name for name in sys.stdlib_module_names if not name.startswith("_")}
    for name in names | {"numpy", "scipy", "numba", "mmt", "mmt_lab", "socketio", "msgpack"}:
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / 'imported')!r}, 'a').write('{name}\\n')\n"
            "raise SystemExit('imported from the current folder')\n"
        )
    return tmp_path


@pytest.mark.parametrize(
    "command",
    [
        ("demo", "virtual-lab", "--share", "--duration", "60"),
        ("scene", "explain", "stream-only", "--no-parts", "--duration", "1"),
        ("bench", "link", "--duration", "0.5"),
    ],
)
def test_no_process_of_a_command_imports_from_its_folder(command, hostile):
    as_installed = 'python=$1; shift; exec "$python" -P "$@"'
    with Service("main", *command, cwd=hostile, within=("sh", "-c", as_installed, "sh")) as run:
        if "--share" in command:  # the page for visitors is a process too
            run.wait_for(lambda: "feel it at http://" in run.stderr + run.stdout)
            run.signal(signal.SIGINT)
        assert run.end() == 0, run.stderr
    imported = hostile / "imported"
    assert not imported.exists(), imported.read_text()


def test_the_folder_is_imported_from_by_a_process_that_is_started_otherwise(hostile):
    for command, code in (([sys.executable], 1), (python_command(), 0)):
        ended = subprocess.run(
            [*command, "-c", "import statistics"],
            cwd=hostile,
            capture_output=True,
            check=False,
            timeout=LONGEST_S,
        )
        assert ended.returncode == code


def test_python_is_started_in_one_way():
    """By `python_command`; and `multiprocessing`, whose command is its own, by one context."""
    texts = {str(file.relative_to(SOURCES)): file.read_text() for file in SOURCES.rglob("*.py")}
    for name in ("sys.executable", "get_context"):
        found = {file for file, text in texts.items() if name in text}
        assert found == ALLOWED[name]


def test_a_process_that_imports_what_this_one_can_does_not_search_the_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    elsewhere = str(tmp_path / "elsewhere")
    monkeypatch.setattr(sys, "path", ["", str(tmp_path), ".", elsewhere])
    monkeypatch.delenv("PYTHONPATH", raising=False)
    assert import_path() == elsewhere
    monkeypatch.setenv("PYTHONPATH", ".")
    assert import_path().split(os.pathsep) == [str(tmp_path), ".", elsewhere]
