"""``mmt session``: simulate, convert, view and recover sessions."""

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from mmt.cli.common import (
    Force,
    json_option,
    messages,
    open_page,
    output,
    stop_on_signals,
    summary_table,
    write_json,
)
from mmt.cli.importing import import_file, inspect_file
from mmt.cli.main import command_group
from mmt.core.errors import InputError
from mmt.core.files.existing import free_path, require_absent, with_number
from mmt.core.kernel_cache import compile_kernels
from mmt.core.output.tables import as_text, plain_table
from mmt.scene import Scene
from mmt.scene.files import load_scene
from mmt.session.files import export_session, read_session, write_session
from mmt.session.formats import find_format, suffixes

app = command_group("Make, convert, view and recover sessions.")

app.command("inspect")(inspect_file)
app.command("import")(import_file)

SourceFile = Annotated[Path, typer.Argument(metavar="FILE", help="A recorded session.")]
TargetFile = Annotated[
    Path, typer.Argument(metavar="OUT", help="The session's file, such as wood.mcap.")
]


@app.command("export")
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


@app.command()
def simulate(
    target: TargetFile,
    *,
    surface: Annotated[
        str | None, typer.Option(help="The known texture; the scene's if absent, else plastic.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Seconds; the scene's if absent, else 18.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of hand and noise; the scene's if absent, else 1.")
    ] = None,
    path: Annotated[
        Path | None, typer.Option(help="A recorded stroke (.npz) in place of the hand.")
    ] = None,
    motion_scale: Annotated[float, typer.Option(help="Factor on the stroke's motion.")] = 1.0,
    force_scale: Annotated[float, typer.Option(help="Factor on the stroke's force.")] = 1.0,
    trials: Annotated[
        int,
        typer.Option(
            min=1, max=999, help="Sessions to make, OUT-1 and so on, of consecutive seeds."
        ),
    ] = 1,
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Simulate this scene's follower and hand.")
    ] = None,
    force: Force = False,
) -> None:
    """Simulate a session on a known texture, and store that texture (the truth) in the file."""
    from mmt.testing.simulation.offline import simulate_session

    scene = load_scene(scene_file) if scene_file is not None else Scene()
    recorded_scene = scene.dump() if scene_file is not None else None
    first = scene.session.seed if seed is None else seed
    files = _trial_files(target, trials)
    for file in files:
        require_absent(file, force=force)
    for trial, file in enumerate(files):
        frames, annotations = simulate_session(
            scene,
            surface,
            duration,
            first + trial,
            path=path,
            motion_scale=motion_scale,
            force_scale=force_scale,
        )
        write_session(file, frames, scene=recorded_scene, annotations=annotations)
        messages.print(f"{len(frames)} frames written to {file}")


def _trial_files(target: Path, trials: int) -> list[Path]:
    """Return the file of each trial, with numbers of equal width."""
    if trials == 1:
        return [target]
    digits = len(str(trials))
    numbers = (f"{number:0{digits}}" for number in range(1, trials + 1))
    return [with_number(target, number) for number in numbers]


@app.command()
def info(
    source: SourceFile,
    json_file: Annotated[Path | None, json_option("Write it there.")] = None,
) -> None:
    """Show what a session file holds."""
    from mmt.session.info import info as session_info
    from mmt.session.operators import control_sentence

    with suppress(InputError):  # without the numerics, the signals' faults are left out
        compile_kernels(["mmt.texture.signals.filtering"], messages.print)
    found = session_info(source)
    content: dict[str, Any] = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in asdict(found).items()
    }
    content["faults"] = None if found.faults is None else found.faults.as_dict()
    content["control"] = [period.as_dict() for period in found.control]
    listeners, hand_overs = content["listeners"], content["hand_overs"]
    apart = ("listeners", "control", "hand_overs", "faults")
    shown = {name: value for name, value in content.items() if name not in apart}
    output.print(summary_table(source.name, {"session": shown}))
    if fault := found.faults and found.faults.sentence():
        output.print(f"not measured: {fault}")
    if listeners:
        output.print(_listener_table(listeners))
    for sentence in (control_sentence(found.control), *hand_overs) if hand_overs else ():
        output.print(sentence)
    write_json(json_file, content)


_LISTENER_COLUMNS: Final = {
    "name": "who",
    "listened_s": "s",
    "lag_p50_ms": "lag, ms",
    "lag_p99_ms": "p99",
    "messages": "sent",
    "bytes": "kB",
    "skipped": "skipped",
    "why": "left",
}


def _listener_table(listeners: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table of listeners: name, time, lag, and messages sent to them."""
    table = plain_table("listeners")
    for name, title in _LISTENER_COLUMNS.items():
        is_text = name in {"name", "why"}
        table.add_column(title, justify="left" if is_text else "right", no_wrap=not is_text)
    for each in listeners:
        sizes = {name: value for name, value in each.items() if name.endswith("_bytes")}
        counts = [each.get(name.removesuffix("_bytes"), 0) for name in sizes]
        shown = {
            **each,
            "name": each.get("name") or f"listener {each.get('id')}",
            "messages": sum(counts) if sizes else None,
            "bytes": sum(sizes.values()) / 1000 if sizes else None,
        }
        values = (shown.get(name) for name in _LISTENER_COLUMNS)
        table.add_row(*("" if value is None else as_text(value) for value in values))
    return table


@app.command()
def view(
    source: SourceFile,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page; 0 for any free one.")
    ] = 0,
    show: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in the browser.")
    ] = True,
) -> None:
    """Show a session file in a browser, moment by moment, as the monitor shows a run."""
    compile_kernels(["mmt.web.viewing.recording"], messages.print)
    from mmt.session.stream import open_windows
    from mmt.web.viewing.recording import ViewedRecording
    from mmt.web.viewing.server import serve_recording

    recording = ViewedRecording(open_windows(source))
    if recording.windows.in_memory:
        messages.print(f"{source} has no index: all of it is held in memory")

    def ready(url: str) -> None:
        output.print(f"{source.name}: {url}")
        messages.print("Ctrl-C ends it")
        if show and not open_page(url):
            messages.print("no browser was found: open the address in one")

    async def serve() -> None:
        ended = asyncio.Event()
        stop_on_signals(ended.set)
        await serve_recording(recording, port, ended, ready)

    asyncio.run(serve())


@app.command()
def recover(
    source: SourceFile,
    target: Annotated[
        Path | None, typer.Argument(metavar="[OUT]", help="FILE with .recovered if absent.")
    ] = None,
    force: Force = False,
) -> None:
    """Save the readable part of a session file that was cut off; FILE is not changed."""
    from mmt.session.recover import recover as recover_session

    if target is None:
        beside = source.parent / f"{source.stem}.recovered{source.suffix}"
        target = beside if force else free_path(beside)
    elif not (source.exists() and target.exists() and source.samefile(target)):
        # `recover` refuses the same file, even with --force
        require_absent(target, force=force)
    saved = recover_session(source, target)
    messages.print(
        f"{saved.frames} frames ({saved.duration_s:.1f} s) saved to {saved.path}; "
        f"{saved.problem or 'the file was whole'}"
    )
