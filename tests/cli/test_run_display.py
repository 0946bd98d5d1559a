"""What a person reads at the end of a run: the verdict, and what to open next."""

import shlex
import shutil
import sys

from hypothesis import given
from hypothesis import strategies as st

from mmt.cli.running.display import command_text, ending_lines, verdict_lines
from mmt.core.verdict import Facts, verdict

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
