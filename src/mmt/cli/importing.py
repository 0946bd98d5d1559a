"""``mmt session inspect`` and ``mmt session import``: recordings of other programs."""

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from mmt.cli.common import Force, json_option, messages, output, write_json
from mmt.core.errors import InputError
from mmt.core.existing_files import require_absent
from mmt.core.frames import CHANNELS
from mmt.core.printable import printable
from mmt.session.data import axis_columns

if TYPE_CHECKING:
    from mmt.session.importing.checks import ImportReport

_SHOWN_NAMES = 40

SourceFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="A file, bag or data set of another program.")
]


class Stamps(StrEnum):
    """Which times the rows get."""

    AUTO = "auto"
    REGULAR = "regular"
    KEPT = "kept"


def inspect_file(source: SourceFile) -> None:
    """Look at a recording of another program, and propose the command that imports it."""
    from mmt.session.importing.proposal import propose
    from mmt.session.importing.recording import import_recording

    proposal = propose(source)
    names = ", ".join(proposal.names[:_SHOWN_NAMES]) or "none"
    more = len(proposal.names) - _SHOWN_NAMES
    output.print(f"columns: {names}{f' and {more} more' if more > 0 else ''}", highlight=False)
    for target in proposal.lacking:
        option = "time=NAME, or --rate HZ" if target == "time" else f"{target}_z=NAME and so on"
        output.print(f"no column was found for {target}: --map {option}", highlight=False)
    if set(CHANNELS) <= set(proposal.lacking):
        output.print("no name tells a channel: say which columns are", highlight=False)
        return
    try:
        _, report = import_recording(source, proposal.options)
    except InputError as error:
        messages.print(f"as proposed it cannot be imported: {error}", highlight=False)
    else:
        print_report(source.name, report)
        proposal = proposal.weighed(report)
    output.print("proposed:", highlight=False)
    output.print(proposal.command(source), highlight=False, soft_wrap=True)


def import_file(
    source: SourceFile,
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="The session's file, such as mine.mcap.")
    ],
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="TARGET=COLUMN",
            help="The column of time, position, force, acceleration (arrays), position_x ... "
            "acceleration_z, or position_time ...; -COLUMN turns the sign, COLUMN[2] is a "
            "component, COLUMN*0.5 scaled, a number a constant. May be repeated.",
        ),
    ] = None,
    units: Annotated[
        list[str] | None,
        typer.Option(
            "--unit",
            metavar="QUANTITY=UNIT",
            help="The unit of time, position, force or acceleration, such as acceleration=g. "
            "May be repeated.",
        ),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Rows a second (Hz) of a file without times.")
    ] = None,
    blanks_as_gaps: Annotated[
        bool,
        typer.Option("--blanks-as-gaps", help="Leave out rows with an empty cell or NaN."),
    ] = False,
    longest_gap: Annotated[
        float | None,
        typer.Option(help="Seconds over which is interpolated; five intervals if absent."),
    ] = None,
    stamps: Annotated[
        Stamps,
        typer.Option(
            help="Rows at the stamps as they are (kept), at the times of the clock behind them "
            "(regular), or whichever fits the motion better (auto)."
        ),
    ] = Stamps.AUTO,
    episode: Annotated[
        int | None, typer.Option(help="Episode of a LeRobot data set; the first if absent.")
    ] = None,
    force: Force = False,
    json_file: Annotated[Path | None, json_option("Write what was found there.")] = None,
) -> None:
    """Import a recording at any rate: a table, arrays, a ROS bag or a LeRobot data set."""
    from mmt.session import export_session
    from mmt.session.importing.options import ImportOptions, assignments
    from mmt.session.importing.recording import import_recording

    require_absent(target, force=force)
    options = ImportOptions(
        columns=assignments(columns or [], "--map"),
        units=assignments(units or [], "--unit"),
        rate_hz=rate,
        blanks_as_gaps=blanks_as_gaps,
        longest_gap_s=longest_gap,
        stamps=stamps.value,
        episode=episode,
    )
    session, report = import_recording(source, options)
    export_session(session, target)
    print_report(source.name, report)
    messages.print(f"{len(session.frames)} frames written to {target}", highlight=False)
    write_json(json_file, {"frames": len(session.frames), **asdict(report)})


def print_report(title: str, report: "ImportReport") -> None:
    """Print what was found in a recording, and what looks wrong."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, padding=0)
    table.add_column("column", no_wrap=True)
    for name in ("rows", "Hz", "jitter ms", "missing", "mean", "lowest", "highest"):
        table.add_column(name, justify="right", no_wrap="jitter" not in name, min_width=6)
    for channel in report.channels:
        clock = (f"{channel.rate_hz:.1f}", f"{channel.jitter_ms:.2f}", str(channel.missing_rows))
        for axis, name in enumerate(axis_columns(channel.channel)):
            figures = (channel.mean[axis], channel.low[axis], channel.high[axis])
            first = (str(channel.rows), *clock) if axis == 0 else ("", "", "", "")
            table.add_row(name, *first, *map(_short, figures))
    output.print(table)
    if report.speed_mm_s is not None:
        output.print(f"speed: up to {report.speed_mm_s:.0f} mm/s (99 %)", highlight=False)
    for warning in report.warnings:
        sentence = Text.assemble(("look:", "yellow"), f" {printable(warning)}")
        messages.print(sentence, soft_wrap=True)


def _short(value: float) -> str:
    return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.3g}"
