"""Show the verdict on a run: in a terminal's status line while it runs, and at its end."""

import shlex
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.control import Control
from rich.segment import ControlType
from rich.text import Text

from mmt.cli.common import messages, output
from mmt.core.output.streams import is_behind
from mmt.core.verdict import State, Verdict

_STYLES: Final[dict[State, str]] = {
    "waiting": "dim",
    "running": "green",
    "degraded": "yellow",
    "failed": "red",
}
"""Colours by state; rich omits them if standard output is no terminal or NO_COLOR is set."""

_OPENERS: Final = {"darwin": "open", "win32": "start"}
_GAP: Final = "   "

_ERASE = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))


@contextmanager
def telling_of_report(directory: Path, recording: Path) -> Iterator[None]:
    """If Ctrl-C ends what is done inside, print the command that makes the report later."""
    try:
        yield
    except KeyboardInterrupt:
        again = command_text("mmt", "evaluate", recording, "--report", directory)
        messages.print(f"the recording is kept; for its report:  {again}")
        raise


class StatusLine:
    """Shows the state of a run in the last line of a terminal, or nothing without a terminal.

    Parameters
    ----------
    console
        Console of standard error.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._shown = False

    def show(self, verdict: Mapping[str, Any], text: str = "") -> None:
        """Show a verdict, as sent to pages, in one line, or `text` if the verdict is empty."""
        console = self._console
        if not console.is_terminal or console.is_dumb_terminal or is_behind(sys.stderr):
            return
        if verdict:
            text = "   ".join(filter(None, (verdict["time"], verdict["sentence"])))
            if verdict["readiness"]:
                text += f"   {verdict['readiness']}"
        line = Text(text, _STYLES[verdict["state"]] if verdict else "", no_wrap=True)
        line.truncate(max(1, console.width - 1), overflow="ellipsis")
        self.clear()
        console.print(line, end="", soft_wrap=True)
        self._shown = True

    def clear(self) -> None:
        """Erase the line, so that other text can be printed there."""
        if self._shown:
            self._console.control(_ERASE)
            self._shown = False

    def print_line(self, sentence: str) -> None:
        """Print a permanent line."""
        self.clear()
        self._console.print(sentence, soft_wrap=True)


def print_ending(
    program: str,
    summaries: Mapping[str, Mapping[str, Any]],
    evaluation: Mapping[str, Any] | None,
    report: Path | None,
) -> None:
    """Print the verdict on a run that has ended, and what to open next.

    See `mmt.evaluation.run_verdict.run_verdict` for the summaries and the evaluation.
    """
    from mmt.evaluation.run_verdict import run_verdict  # not needed while a service runs

    found, leader = run_verdict(summaries, evaluation), summaries.get("leader", {})
    for line in ending_lines(program, found, leader, report, output.width):
        output.print(line, soft_wrap=True)


def ending_lines(
    program: str,
    found: Verdict,
    leader: Mapping[str, Any],
    report: Path | None = None,
    width: int = 80,
) -> list[Text]:
    """Return the verdict on a run that has ended, and a line for each thing to open next.

    Parameters
    ----------
    program
        The program that was run, as typed.
    found
        The verdict.
    leader
        The leader's summary, as written by ``--json``; empty if there is none.
    report
        The report's page, or None.
    width
        Columns of the terminal.
    """
    lines = verdict_lines(program, found, width)
    recording = leader.get("recording") or {}
    steps = [] if report is None else [_to_open(report)]
    if recording.get("file"):
        verb = "recover" if recording.get("error") else "view"
        steps.append(command_text("mmt", "session", verb, recording["file"]))
    return lines + [Text.assemble(("next:", "bold"), f"  {step}") for step in steps]


def verdict_lines(title: str, found: Verdict, width: int) -> list[Text]:
    """Return lines with a title and the verdict's parts, and a line for each other fault.

    Lines are broken between parts.
    """
    indent = " " * (len(title) + 2)
    rows = list(_rows(found.parts, width - len(indent)))
    style = _STYLES[found.state]
    first = Text.assemble((title, f"bold {style}"), f"  {rows[0] if rows else ''}")
    rest = [Text(indent + row) for row in rows[1:]]
    unsaid = [fault for fault in found.faults if fault not in found.now]
    return [first, *rest, *(Text(indent + fault, style) for fault in unsaid)]


def _rows(parts: tuple[str, ...], width: int) -> Iterator[str]:
    row = ""
    for part in parts:
        if row and len(row) + len(_GAP) + len(part) > width:
            yield row
            row = part
        else:
            row += _GAP * bool(row) + part
    yield row


def command_text(program: str, *arguments: object) -> str:
    """Return a command for the user to type.

    The program is named by its path if the shell would not find this installation's program, as
    after ``./scripts/demo``.
    """
    beside, found = Path(sys.executable).parent / program, shutil.which(program)
    if beside.exists() and (found is None or not beside.samefile(found)):
        here = Path.cwd()
        program = str(beside.relative_to(here) if beside.is_relative_to(here) else beside)
    return shlex.join([program, *map(str, arguments)])


def _to_open(page: Path) -> str:
    """Return a command that opens a page, or the page's path if there is no such command."""
    opener = _OPENERS.get(sys.platform, "xdg-open")
    has_one = opener == "start" or shutil.which(opener) is not None
    return shlex.join([opener, str(page)]) if has_one else str(page)
