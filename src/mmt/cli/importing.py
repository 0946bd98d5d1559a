"""``mmt session inspect`` and ``mmt session import``: import recordings of other programs."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from mmt.cli.common import Force, json_option, messages, output, write_json
from mmt.cli.options import with_options
from mmt.core.errors import printable
from mmt.core.files.existing import require_absent
from mmt.core.frames import CHANNELS
from mmt.core.output.tables import plain_table
from mmt.session.data import axis_columns
from mmt.session.importing.stamps import StampChoice

if TYPE_CHECKING:
    from mmt.session.importing.checks import ImportReport
    from mmt.session.importing.options import ImportOptions

_SHOWN_NAMES = 40
_OF_TEXTS = "Texts and workbooks"
_OF_LIMITS = "Limits of reading"

SourceFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="A file, bag or data set of another program.")
]


@dataclass(frozen=True)
class ReadingOptions:
    """Options that many recordings of other programs need, named as in `ImportOptions`."""

    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="TARGET=COLUMN",
            help="The column of time, position, force, acceleration, orientation (arrays), "
            "position_x ..., orientation_w, position_time ..., or speed for position; -COLUMN "
            "turns the sign, COLUMN[2] is a component, COLUMN*0.5 scaled, a number a constant. "
            "May be repeated.",
        ),
    ] = None
    units: Annotated[
        list[str] | None,
        typer.Option(
            "--unit",
            metavar="QUANTITY=UNIT",
            help="The unit of time, position, force, acceleration or speed, such as "
            "acceleration=g, or of one target, such as position_z=um. May be repeated.",
        ),
    ] = None
    rate_hz: Annotated[
        float | None,
        typer.Option(
            "--rate",
            help="Rows a second (Hz), in place of the file's times; of several files, of those "
            "without.",
        ),
    ] = None
    acceleration_rate_hz: Annotated[
        int | None,
        typer.Option(
            "--acceleration-rate",
            help="Hz at which acceleration is kept, 1000 to 10000 in steps of 1000; 1000 if "
            "absent, or that of a file that mmt exported.",
        ),
    ] = None
    reading_memory_gb: Annotated[
        float | None,
        typer.Option(
            "--reading-memory",
            metavar="GB",
            help="Memory to read a file of another format; 2 GB and 16 times its size if absent.",
            rich_help_panel=_OF_LIMITS,
        ),
    ] = None
    reading_time_s: Annotated[
        float | None,
        typer.Option(
            "--reading-time",
            metavar="S",
            help="Time to read it; 60 s, and 5 s for each MB, if absent.",
            rich_help_panel=_OF_LIMITS,
        ),
    ] = None

    def checked(self, **others: Any) -> "ImportOptions":
        """Return the options and others as an import takes them.

        Raises
        ------
        InputError
            See `ImportOptions`.
        """
        from mmt.session.importing.options import ImportOptions, assignments

        given: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in vars(self).items()
            if value is not None
        }
        given["columns"] = assignments(self.columns or [], "--map")
        given["units"] = assignments(self.units or [], "--unit")
        return ImportOptions(**given, **others)


@dataclass(frozen=True)
class ImportingOptions(ReadingOptions):
    """All options for recordings of other programs, but those of several files."""

    blanks_as_gaps: Annotated[
        bool, typer.Option("--blanks-as-gaps", help="Leave out rows with an empty cell or NaN.")
    ] = False
    longest_gap_s: Annotated[
        float | None,
        typer.Option(
            "--longest-gap", help="Seconds over which is interpolated; five intervals if absent."
        ),
    ] = None
    stamps: Annotated[
        StampChoice,
        typer.Option(
            help="Rows at the stamps as they are (kept), at the times of the clock behind them "
            "(regular), or whichever fits the motion better (auto). Of messages: by the clock of "
            "their header, or of their receipt."
        ),
    ] = "auto"
    episode: Annotated[
        str | None,
        typer.Option(help="Episode or trial of a file with several; the first if absent."),
    ] = None
    header: Annotated[
        int | None,
        typer.Option(
            help="Line with the columns' names, from 1; looked for if absent.",
            rich_help_panel=_OF_TEXTS,
        ),
    ] = None
    sheet: Annotated[
        str | None,
        typer.Option(help="Sheet of a workbook, by name or number.", rich_help_panel=_OF_TEXTS),
    ] = None
    separator: Annotated[
        str | None,
        typer.Option(
            help="Between the cells: comma, semicolon, tab, blank or a sign.",
            rich_help_panel=_OF_TEXTS,
        ),
    ] = None
    decimal: Annotated[
        str | None,
        typer.Option(help="The decimal sign of a text, . or a comma.", rich_help_panel=_OF_TEXTS),
    ] = None
    missing: Annotated[
        list[str] | None,
        typer.Option(
            help="What stands for no value, such as 9999. May be repeated.",
            rich_help_panel=_OF_TEXTS,
        ),
    ] = None
    tool_axes: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CHANNEL",
            help="Force or acceleration that turned with the tool: it is turned into the base's "
            "axes by the orientation. May be repeated.",
        ),
    ] = None


@with_options
def inspect_file(source: SourceFile, options: ImportingOptions) -> None:
    """Look at a recording of another program, and propose the command that imports it."""
    from mmt.session.importing.proposal import propose, try_proposal

    proposal = propose(source, options.checked())
    names = ", ".join(proposal.names[:_SHOWN_NAMES]) or "none"
    more = len(proposal.names) - _SHOWN_NAMES
    output.print(f"columns: {names}{f' and {more} more' if more > 0 else ''}")
    for target in proposal.lacking:
        option = "time=NAME, or --rate HZ" if target == "time" else f"{target}_z=NAME and so on"
        output.print(f"no column was found for {target}: --map {option}")
    if set(CHANNELS) <= set(proposal.lacking):
        output.print("no name tells a channel: say which columns are")
        print_warnings(proposal.columns.notes)
        return
    proposal, report, error = try_proposal(source, proposal)
    if report is not None:
        print_report(source.name, report)
        output.print("proposed:")
    else:
        print_warnings(proposal.columns.notes)
        messages.print(f"it cannot be imported yet: {error}")
        output.print("to be completed:")
    output.print(proposal.command(source), soft_wrap=True)


@with_options
def import_file(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="A file of another program, or several of a recording."
        ),
    ],
    *,
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="The session's file, such as mine.mcap.")
    ],
    options: ImportingOptions,
    offsets: Annotated[
        list[str] | None,
        typer.Option(
            "--offset",
            metavar="FILE=S",
            help="Seconds to add to the times of one of several files, or match: found by shocks "
            "that are in both. May be repeated.",
        ),
    ] = None,
    force: Force = False,
    json_file: Annotated[Path | None, json_option("Write what was found there.")] = None,
) -> None:
    """Import a recording at any rate: a table, arrays, a ROS bag or a LeRobot data set."""
    from mmt.session.files import export_session
    from mmt.session.importing.modelled_share import modelled_sentence
    from mmt.session.importing.options import assignments
    from mmt.session.importing.recording import import_recording

    checked = options.checked(offsets=assignments(offsets or [], "--offset"))
    require_absent(target, force=force)
    session, report = import_recording(sources, checked)
    export_session(session, target)
    print_report(", ".join(source.name for source in sources), report)
    rates = [c.rate_hz for c in report.channels if c.channel == "acceleration"]
    if rates and (sentence := modelled_sentence(session.frames, rates[0])):
        output.print(sentence, soft_wrap=True)
    messages.print(f"{len(session.frames)} frames written to {target}")
    found = {**asdict(report), "told": sorted(report.told)}
    write_json(json_file, {"frames": len(session.frames), **found})


def print_report(title: str, report: "ImportReport") -> None:
    """Print a table of a recording's columns, and warnings."""
    table = plain_table(title, padding=0)
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
        output.print(f"speed: up to {report.speed_mm_s:.0f} mm/s (99 %)")
    print_warnings(report.warnings)


def print_warnings(warnings: Iterable[str]) -> None:
    """Print what a person should look at, a line each."""
    for warning in warnings:
        sentence = Text.assemble(("look:", "yellow"), f" {printable(warning)}")
        messages.print(sentence, soft_wrap=True)


def _short(value: float) -> str:
    return f"{value:.0f}" if 1000 <= abs(value) < 1e6 else f"{value:.3g}"
