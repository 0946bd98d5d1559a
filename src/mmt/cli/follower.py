"""``mmt-follower``: measure and stream."""

import asyncio
import logging
from pathlib import Path
from typing import Annotated, Final

import typer

from mmt.cli.common import (
    messages,
    output,
    print_parts,
    run_app,
    stop_on_signals,
    version,
    with_inventory,
    write_json,
    write_line,
)
from mmt.core.errors import InputError, MmtError
from mmt.core.logs import Logs, details
from mmt.core.realtime import be_real_time, require_real_time
from mmt.core.version import __version__
from mmt.follower.service import Follower, FollowerSummary
from mmt.scene import Scene
from mmt.scene.files import load_scene

LOG: Final = logging.getLogger("mmt.follower")

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def follower(
    scene_file: Annotated[
        Path, typer.Argument(metavar="SCENE", help="A TOML file, or an example's name.")
    ],
    leader: Annotated[
        str | None, typer.Option(metavar="URL", help="The leader; the scene's \\[link] if absent.")
    ] = None,
    replay: Annotated[Path | None, typer.Option(help="Replay this recorded session.")] = None,
    speed: Annotated[
        float | None, typer.Option(help="Replay this many times faster than real time.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the summary there.")
    ] = None,
    json_lines: Annotated[
        bool, typer.Option("--json-lines", help="Events and summary as JSON lines on stdout.")
    ] = False,
    log: Annotated[
        Path | None, typer.Option(help="Add a JSON line per event to this file.")
    ] = None,
    log_level: Annotated[
        str | None, typer.Option(metavar="LEVEL", help="debug, info, warning or error.")
    ] = None,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Tick by real-time scheduling (Linux).")
    ] = False,
    _: Annotated[
        bool, typer.Option("--version", callback=version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Stream one session: read the scene's source and send it to the leader."""
    scene = load_scene(scene_file, replay=replay)
    if speed is not None:
        if scene.replay is None:
            raise InputError("--speed is for a replay: give --replay FILE, or a scene of one")
        scene = load_scene(scene_file, {"replay.speed": speed}, replay=replay)
    if realtime:
        require_real_time()
    if not json_lines:
        print_parts(scene, "follower")
    with Logs("follower", log, log_level) as logs:
        LOG.info("started", extra=details(version=__version__, scene=scene.dump()))
        summary = asyncio.run(_stream(scene, leader, json_lines, logs, realtime))
        LOG.info("summary", extra=details(summary=summary.as_dict()))
    if json_lines:
        write_line("summary", **summary.as_dict())
    else:
        from mmt.cli.common import summary_table

        output.print(summary_table("follower", summary.as_dict()))
    write_json(json_file, summary.as_dict())
    if summary.problem is not None:
        raise MmtError(summary.problem)


async def _stream(
    scene: Scene, url: str | None, json_lines: bool, logs: Logs, realtime: bool
) -> FollowerSummary:
    def say(sentence: str) -> None:
        if json_lines:
            write_line("event", event=sentence)
        else:
            messages.print(sentence, highlight=False)

    def note(session_id: str) -> None:
        logs.session_id = session_id

    service = Follower(scene, url, on_event=say, on_session=note)
    stop_on_signals(service.stop)
    say(f"{service.source.describe()}; leader {service.url}")

    def ready() -> None:
        if realtime:
            be_real_time()
        if json_lines:
            write_line("ready")

    running = service.run(ready)
    return await (with_inventory(running) if json_lines else running)


def run() -> None:
    """Run ``mmt-follower``."""
    run_app(app, "mmt-follower")


if __name__ == "__main__":
    run()
