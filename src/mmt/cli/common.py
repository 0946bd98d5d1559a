"""Shared by the command lines: errors, JSON, progress as lines, interruption, pages to open."""

import asyncio
import errno
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from mmt.cli.options import simplify_help
from mmt.core.errors import InputError, MmtError, printable
from mmt.core.extras import __version__, optional_import
from mmt.core.output.streams import finish_output, hurry_output, is_queued, queue_output
from mmt.core.running.programs import on_end_signal, restoring_end_signals

STANDARD_OUTPUT: Final = Path("-")
"""Value of a file option that stands for standard output."""

MODEL_NAME: Final = "model.npz"
"""File name of a run's newest model, beside its report."""

Force: TypeAlias = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
"""Without this option no command replaces a file; see `mmt.core.files.existing`."""

OPTIONS: Final = {
    "session.duration_s": "--duration",
    "link.port": "--port",
    "rendering.model": "--model",
    "replay.speed": "--speed",
}
"""Names of the options that set keys of a scene, for error messages."""

_KEPT: Final = "\n\t"

_UNREACHABLE: Final = {errno.EACCES, errno.ENAMETOOLONG, errno.ESTALE, errno.EIO}
"""Errors of asking whether a file exists, as far as `Path.exists` raises them."""


class Terminal(Console):
    """A console that masks control characters, which a peer, a device or a file may send.

    Figures in tables wider than the terminal are not cut off.
    """

    def print(self, *objects: Any, crop: bool = False, **options: Any) -> None:
        """Print as `Console.print` does."""
        super().print(*objects, crop=crop, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return a text with control characters masked."""
        return super().render_str(printable(text, keep=_KEPT), **options)


output = Terminal(markup=False, emoji=False, highlight=False)
"""Standard output, for results; brackets in a text, such as a table's name, are not markup."""

messages = Terminal(stderr=True, markup=False, emoji=False, highlight=False)
"""Standard error, for progress, notes and errors."""
messages.soft_wrap = not messages.is_terminal  # programs read unwrapped lines


def run_app(app: typer.Typer, program: str) -> None:
    """Run a command line; an `MmtError` is printed without a traceback.

    Parameters
    ----------
    app
        The commands.
    program
        Name of the program in the help.
    """
    try:
        with optional_import():
            simplify_help(typer.main.get_command(app))(prog_name=program)
    except MmtError as error:
        print_error(str(error))
        sys.exit(error.exit_code)
    except OSError as error:
        if error.errno in {errno.EMFILE, errno.ENFILE}:
            print_error(
                "too many files are open: raise the limit before the start (`ulimit -n 256`), or "
                "end other programs"
            )
            sys.exit(MmtError.exit_code)
        if error.errno not in _UNREACHABLE or error.filename is None:
            raise
        print_error(
            f"{error.filename}: {error.strerror}: correct the path, or see that you may enter each "
            "of its folders"
        )
        sys.exit(InputError.exit_code)
    finally:
        finish_output()


def print_error(sentence: str) -> None:
    """Print an error to standard error, if that is writable."""
    with suppress(OSError):
        error = Text.assemble(("error:", "red"), f" {printable(sentence, keep=_KEPT)}")
        messages.print(error, soft_wrap=True)


@contextmanager
def noting(problems: list[Exception], what: str = "") -> Iterator[None]:
    """Collect an error of the block and continue after the block; see `raise_problems`.

    Parameters
    ----------
    problems
        List to which the error is appended; `OSError` with equal messages only once.
    what
        Subject of an `OSError`, for the message.
    """
    try:
        yield
    except BrokenPipeError:  # the reader has closed the pipe
        raise
    except OSError as error:
        sentence = f"{what}: {error.strerror or error}"
        if sentence not in map(str, problems):
            problems.append(MmtError(sentence))
    except Exception as error:  # noqa: BLE001 - raised in the end
        problems.append(error)


def raise_problems(problems: list[Exception]) -> None:
    """Print all problems but one, and raise that one: an unexpected exception if there is any."""
    ordered = sorted(problems, key=lambda problem: not isinstance(problem, MmtError))
    for problem in ordered[:-1]:
        print_error(str(problem))
    if ordered:
        raise ordered[-1]


def version(wanted: bool) -> None:
    """Print the version and exit, if the eager option ``--version`` is given."""
    if wanted:
        output.print(f"mmt-haptics {__version__}")
        raise typer.Exit


def json_option(help_text: str) -> Any:
    """Return the option ``--json`` of a command with results."""

    def taken(path: Path | None) -> Path | None:
        output.stderr = path == STANDARD_OUTPUT  # then tables go to standard error
        return path

    return typer.Option(
        "--json", callback=taken, help=f"{help_text} A file, or - for standard output."
    )


def report_option(help_text: str = "Write a report there.") -> Any:
    """Return the option ``--report``: a folder, with a number if it already holds a report."""

    def taken(folder: Path | None) -> Path | None:
        from mmt.core.files.existing import free_folder

        return None if folder is None else free_folder(folder)

    return typer.Option("--report", metavar="FOLDER", callback=taken, help=help_text)


def write_json(path: Path | None, content: object) -> None:
    """Write a result as JSON to a file, to standard output for ``-``, or nowhere for None.

    Raises
    ------
    InputError, MmtError
        The result cannot be written.
    """
    if path is None:
        return
    text = json.dumps(content, indent=2) + "\n"
    if path != STANDARD_OUTPUT:
        from mmt.core.files.existing import write_file

        write_file(path, text)
        return
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has closed the pipe
        raise
    except OSError as error:
        raise MmtError(f"--json {path}: {error.strerror or error}") from error


def require_one_output(json_file: Path | None, *, json_lines: bool) -> None:
    """Raise `InputError` if two options write to standard output."""
    if json_lines and json_file == STANDARD_OUTPUT:
        raise InputError("--json - and --json-lines both take standard output: give one")


def write_line(kind: str, **content: Any) -> None:
    """Write one JSON line to standard output."""
    sys.stdout.write(json.dumps({"kind": kind, **content}) + "\n")
    sys.stdout.flush()


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` on the first end signal; a second signal ends the process at once.

    End signals are Ctrl-C, termination and a closed terminal. Output is queued, so that a slow
    reader does not delay the end.
    """
    queue_output()
    loop = asyncio.get_running_loop()

    def asked() -> None:
        hurry_output()
        if loop.is_closed():
            raise KeyboardInterrupt
        loop.call_soon_threadsafe(stop)

    on_end_signal(asked)
    # With a handler in the loop every signal wakes it; else a signal just before the loop waits
    # would go unnoticed until the next event. SIGURG does nothing. Windows needs no handler.
    with suppress(NotImplementedError, AttributeError):
        loop.add_signal_handler(signal.SIGURG, lambda: None)


@contextmanager
def stopping_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Do as `stop_on_signals` in the block, and leave output and signals as they were before.

    After an end signal the next one still ends the process at once.
    """
    queued = is_queued()
    with restoring_end_signals():
        stop_on_signals(stop)
        try:
            yield
        finally:
            if not queued:
                finish_output()


def summary_table(title: str, summary: Mapping[str, Any]) -> Table:
    """Return a summary's nested mappings as a table with rows of part, figure and value."""
    from mmt.core.output.tables import as_text, flatten, plain_table

    table = plain_table(title, header=False)
    table.add_column("part", style="bold")
    table.add_column("figure")
    table.add_column("value")
    for part, content in summary.items():
        values = flatten(content) if isinstance(content, Mapping) else {"": content}
        rows = [(name, as_text(v)) for name, v in values.items() if v not in (None, "", [], {})]
        for index, (name, value) in enumerate(rows):
            last = index == len(rows) - 1
            table.add_row(part if index == 0 else "", name, value, end_section=last)
    return table


def open_page(url: str) -> bool:
    """Open a page in a browser without waiting; return whether there is a browser.

    Without a graphical desktop there is none.
    """
    import webbrowser

    has_screen = sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("BROWSER")
    )
    if not has_screen:
        return False
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return False
    threading.Thread(target=browser.open, args=(url,), name="browser", daemon=True).start()
    return True
