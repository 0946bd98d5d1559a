"""Ctrl-C ends a command with 130, whatever its library makes of it."""

import io
import os
import signal
import sys
import types

import pytest
import typer

from mmt.cli import entry
from mmt.cli.common import run_app
from mmt.cli.running.display import telling_of_report
from mmt.core.errors import MmtError
from mmt.core.running.programs import restoring_end_signals


@pytest.fixture(autouse=True)
def usual_handler():
    # a shell lets what it starts in the background ignore Ctrl-C
    with restoring_end_signals():
        signal.signal(signal.SIGINT, signal.default_int_handler)
        yield


def ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)
    raise AssertionError("not interrupted")


class InterruptedInput(io.StringIO):
    def readline(self, *_):
        ctrl_c()
        return ""


def at_a_prompt():
    typer.prompt("x points up", default="", err=True)


def translated(error):
    try:
        ctrl_c()
    except KeyboardInterrupt as interrupt:
        raise error from interrupt


def as_an_old_typer_translates_it():
    translated(typer.Abort())


def told_by_the_command():
    translated(MmtError("interrupted: 3 results are kept"))


def fails():
    raise MmtError("no answer")


def exit_code(command, monkeypatch):
    """Run a command as an installed program does, and return its exit code."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(command)
    module = types.ModuleType("mmt.cli.tried")
    vars(module)["run"] = lambda: run_app(app, "tried")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(sys, "argv", ["tried"])
    with pytest.raises(SystemExit) as ended:
        entry.start("tried")
    return ended.value.code


@pytest.mark.parametrize(
    "command", [ctrl_c, at_a_prompt, as_an_old_typer_translates_it, told_by_the_command]
)
def test_an_interrupted_command_ends_with_130(command, monkeypatch, capfd):
    monkeypatch.setattr(sys, "stdin", InterruptedInput())
    assert exit_code(command, monkeypatch) == entry.INTERRUPTED == 130
    told = capfd.readouterr().err
    assert told.endswith("stopped\n")
    assert "Traceback" not in told


def test_another_failure_keeps_its_exit_code(monkeypatch):
    assert exit_code(fails, monkeypatch) == 1


def test_an_interrupted_report_says_how_to_make_it_later(monkeypatch, capfd, tmp_path):
    def report():
        with telling_of_report(tmp_path / "report", tmp_path / "a.mcap"):
            raise KeyboardInterrupt

    assert exit_code(report, monkeypatch) == entry.INTERRUPTED
    told = capfd.readouterr().err
    assert f"mmt evaluate {tmp_path / 'a.mcap'} --report {tmp_path / 'report'}" in told
    assert told.endswith("stopped\n")
