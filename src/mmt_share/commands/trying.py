"""``mmt try``: a recording of another program, modelled and played at once."""

import asyncio
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mmt.cli.common import Force, messages, open_page, output
from mmt.cli.importing import ReadingOptions, SourceFile, print_report, print_warnings
from mmt.cli.models import SUFFIX, built
from mmt.cli.options import with_options
from mmt.core.errors import InputError
from mmt.core.files.existing import require_absent, write_file
from mmt.core.kernel_cache import compile_kernels
from mmt.scene import Link
from mmt_share.commands.playing import serve_until_ended

if TYPE_CHECKING:
    from mmt.session.data import RecordedSession
    from mmt.session.importing.options import ImportOptions
    from mmt.session.importing.proposal import Proposal


@with_options
def try_recording(
    source: SourceFile,
    options: ReadingOptions,
    port: Annotated[int, typer.Option(help="Listen on this port; 0 takes any free one.")] = 8770,
    force: Force = False,
) -> None:
    """Import a recording of one surface, build its model and play it; ask what is not clear."""
    target = Path(source.stem + SUFFIX)
    require_absent(target, force=force)
    compile_kernels(["mmt.cli.reporting", "mmt_share.player.player"], messages.print)
    from mmt.cli.reporting import scene_of
    from mmt_share.player.player import Player
    from mmt_share.player.results import ResultsFile

    session = _session(source, options.checked())
    model, update, _ = built([session], scene_of(session))
    write_file(target, model.to_bytes())
    progress = update.progress
    share_text = f"{100.0 * progress.value:.0f} % of strokes should feel right"
    messages.print(f"model:    {target}, {share_text if progress.scale.rises else progress}")
    player = Player([source.stem], [model], results=ResultsFile("mmt-play.csv"), scenarios=False)
    asyncio.run(serve_until_ended(player, Link(port=port), on_page=open_page))


def _session(source: Path, options: "ImportOptions") -> "RecordedSession":
    """Return a session of mmt as it is; import any other file, and show what was found."""
    from mmt.session.files import read_session
    from mmt.session.importing.proposal import try_proposal
    from mmt.session.importing.recording import import_columns

    if source.suffix.lower() == ".mcap":
        with suppress(InputError):  # a file of another program
            return read_session(source)
    proposal, report, error = try_proposal(source, _completed(source, options))
    if report is None:
        print_warnings(proposal.columns.notes)
        raise error or InputError(f"{source}: it cannot be imported")
    print_report(source.name, report)
    output.print(f"imported as by: {proposal.command(source)}", soft_wrap=True)
    return import_columns([proposal.columns], [source], proposal.options)[0]


def _completed(source: Path, options: "ImportOptions") -> "Proposal":
    """Return how to import a file, and ask a person for what its columns do not tell."""
    from mmt.session.importing.proposal import propose

    proposal = propose(source, options)
    if proposal.lacking:
        print_warnings(proposal.columns.notes)
    for target in proposal.lacking:
        if not sys.stdin.isatty():
            option = "--rate HZ" if target == "time" else f"--map {target}_z=NAME"
            raise InputError(
                f"{source}: no column was found for {target}; say it by {option}, or first import "
                "the file by mmt session import, which has more options"
            )
        options = _asked(target, proposal.names, options)
    return propose(source, options) if proposal.lacking else proposal


def _asked(target: str, names: Sequence[str], options: "ImportOptions") -> "ImportOptions":
    """Ask for the rows a second, or for the columns of a channel."""
    if target == "time":
        hertz = typer.prompt("No column tells the time. Rows a second (Hz)", type=float, err=True)
        return replace(options, rate_hz=hertz)
    messages.print(f"columns: {', '.join(names)}")
    question = f"Which are the {target} along x, y and z? Three, one of three elements, or z alone"
    answer = typer.prompt(question, err=True).replace(",", " ").split()
    if len(answer) == 3:
        told = {f"{target}_{axis}": name for axis, name in zip("xyz", answer, strict=True)}
    elif len(answer) != 1:
        raise InputError(f"{target}: {len(answer)} columns were named, it must be one or three")
    elif f"{answer[0]}[0]" in names:
        told = {target: answer[0]}
    else:
        told = {f"{target}_x": "0", f"{target}_y": "0", f"{target}_z": answer[0]}
    return replace(options, columns={**options.columns, **told})
