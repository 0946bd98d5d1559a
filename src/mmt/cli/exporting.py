"""``mmt session export``: write sessions in formats of other tools."""

from pathlib import Path
from typing import Annotated, Any

import typer

from mmt.cli.common import Force, messages
from mmt.core.errors import InputError
from mmt.core.existing_files import require_absent
from mmt.session import export_session, read_session
from mmt.session.formats import find_format, suffixes


def export_file(
    sources: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recorded sessions.")],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="A file, or a folder for a bag or data set.")
    ],
    data_set: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="NAME",
            help="Make the folder OUT a data set (lerobot), with an episode of each FILE.",
        ),
    ] = None,
    fps: Annotated[
        int | None, typer.Option(help="Rows a second of the data set; 50 if absent.")
    ] = None,
    task: Annotated[
        str | None, typer.Option(help='What is done; "stroke the surface" if absent.')
    ] = None,
    scalars: Annotated[
        bool, typer.Option("--scalars", help="In .mcap each frame also as numbers to plot.")
    ] = False,
    force: Force = False,
) -> None:
    """Export by the suffix of OUT: .csv, .npz, .mat, .wav, .parquet, .h5, .mcap, none for a bag."""
    if data_set is not None:
        if scalars:
            raise InputError("--scalars is for .mcap files: leave it out")
        _export_data_set(data_set, sources, target, {"fps": fps, "task": task}, force=force)
        return
    for option, value in {"--fps": fps, "--task": task}.items():
        if value is not None:
            raise InputError(f"{option} is for a data set: add --to lerobot, or leave it out")
    if len(sources) > 1:
        raise InputError(
            f"{target} takes one session, not {len(sources)}; a data set takes several: add "
            "--to lerobot"
        )
    require_absent(target, force=force)
    session = read_session(sources[0])
    export_session(session, target, scalars=scalars)
    messages.print(f"{len(session.frames)} frames written to {target}")


def _export_data_set(
    kind: str, sources: list[Path], target: Path, options: dict[str, Any], *, force: bool
) -> None:
    join = find_format("join", Path(f"sessions.{kind}"))
    if join is None:
        allowed = ", ".join(name[1:] for name in suffixes("join"))
        raise InputError(f"--to {kind}: allowed are {allowed or 'none'}")
    given = {name: value for name, value in options.items() if value is not None}
    rows = join(map(read_session, sources), target, replace=force, **given)
    episodes = f"{len(sources)} episode{'s' if len(sources) > 1 else ''}"
    messages.print(f"{rows} rows in {episodes} written to {target}")
