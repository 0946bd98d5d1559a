"""What a person reads: of strangers nothing that moves the cursor, of a run its verdict."""

import errno
import io
import shlex
import shutil
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table

from mmt.cli.common import STANDARD_OUTPUT, messages, output, print_error, write_json
from mmt.cli.importing import print_report
from mmt.cli.running.display import command_text, ending_lines, verdict_lines
from mmt.core.errors import MmtError
from mmt.core.verdict import Facts, verdict
from mmt.session.importing.checks import ImportReport

EVIL = "\x1b[2J\x1b]0;owned\x07\u202e\r"


def test_no_control_character_is_printed(capsys):
    table = Table(EVIL)
    table.add_row(EVIL)
    output.print(f"a\nb\tc{EVIL}", table)
    messages.print(EVIL)
    print_error(EVIL)
    print_report(EVIL, ImportReport((), None, (EVIL,)))
    told = capsys.readouterr()
    for text in (told.out, told.err):
        assert "[2J" in text
        assert not set(text) & set("\x1b\x07\u202e\r")
    assert told.out.startswith("a\nb")


class FullDisk(io.StringIO):
    def write(self, text):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_json_that_standard_output_does_not_take_is_an_error_for_a_person(monkeypatch):
    monkeypatch.setattr(sys, "stdout", FullDisk())
    with pytest.raises(MmtError, match="--json -: No space left on device"):
        write_json(STANDARD_OUTPUT, {"a": 1})


FOUND = verdict(
    Facts(
        time_s=18.0,
        mode="synthesized",
        start_s=3.0,
        stop_s=11.0,
        outcome="completed",
        models=True,
        readiness=0.84,
        error_db=1.1,
        faults=["49 % of the ticks late"],
    )
)


@given(st.integers(80, 200))
def test_a_verdict_fits_a_terminal_and_loses_nothing(width):
    lines = [line.plain for line in verdict_lines("mmt demo", FOUND, width)]
    assert max(map(len, lines)) <= width
    assert " ".join(" ".join(lines).split()) == " ".join(["mmt demo", *FOUND.parts, *FOUND.faults])


def test_what_to_open_next_can_be_typed(tmp_path, monkeypatch):
    report = tmp_path / "a report.html"
    recording = {"recording": {"file": str(tmp_path / "a b.mcap"), "error": None}}
    monkeypatch.setattr(shutil, "which", lambda _: sys.executable)
    lines = [line.plain for line in ending_lines("mmt demo", FOUND, recording, report)]
    steps = [line.removeprefix("next:  ") for line in lines if line.startswith("next:")]
    assert [shlex.split(step)[-1] for step in steps] == [str(report), str(tmp_path / "a b.mcap")]
    recording["recording"]["error"] = "disk full"
    assert "session recover" in ending_lines("mmt demo", FOUND, recording)[-1].plain
    # as after ./scripts/demo, whose environment the shell does not know
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv/mmt").touch(mode=0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv/python"))
    monkeypatch.setattr(shutil, "which", lambda _: None)
    assert command_text("mmt", "session", "view", "a b.mcap") == ".venv/mmt session view 'a b.mcap'"
    monkeypatch.setattr(shutil, "which", lambda _: str(tmp_path / ".venv/mmt"))
    assert command_text("mmt", "demo") == "mmt demo"
