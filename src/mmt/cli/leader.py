"""``mmt-leader``: model and render."""

import asyncio
import logging
import signal
import time
from pathlib import Path
from typing import Annotated, Any, Final

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
from mmt.core.kernel_cache import kernels_are_compiled
from mmt.core.logs import Logs, details
from mmt.core.realtime import be_real_time, require_real_time
from mmt.core.version import __version__
from mmt.leader.summary import LeaderStatus, LeaderSummary
from mmt.scene import Scene
from mmt.scene.files import load_scene

LOG: Final = logging.getLogger("mmt.leader")

_STARTED_S = time.perf_counter()

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def leader(
    scene_file: Annotated[
        Path, typer.Argument(metavar="SCENE", help="A TOML file, or an example's name.")
    ],
    replay: Annotated[
        Path | None, typer.Option(help="The follower replays this session: leave the hand out.")
    ] = None,
    record: Annotated[Path | None, typer.Option(help="Record into this MCAP file.")] = None,
    model: Annotated[Path | None, typer.Option(help="Render from this saved model.")] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write a report of the recording there.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Seconds of the session.")] = None,
    port: Annotated[
        int | None, typer.Option(help="Listen on this port; 0 takes any free one.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the summary there.")
    ] = None,
    json_lines: Annotated[
        bool, typer.Option("--json-lines", help="Status and summary as JSON lines on stdout.")
    ] = False,
    log: Annotated[
        Path | None, typer.Option(help="Add a JSON line per event to this file.")
    ] = None,
    log_level: Annotated[
        str | None, typer.Option(metavar="LEVEL", help="debug, info, warning or error.")
    ] = None,
    monitor: Annotated[
        bool, typer.Option("--monitor", help="Serve a page that shows the run.")
    ] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Tick by real-time scheduling (Linux).")
    ] = False,
    _: Annotated[
        bool, typer.Option("--version", callback=version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Serve one session: receive the follower's stream, model the texture, render it."""
    overrides = {
        "session.duration_s": duration,
        "link.port": port,
        "rendering.model": str(model) if model else None,
    }
    scene = load_scene(scene_file, overrides, replay=replay, record=record, monitor=monitor)
    if realtime:
        require_real_time()
    if report is not None and scene.recording is None:
        raise InputError("--report needs a recording: give --record FILE or add [recording]")
    if not json_lines:
        print_parts(scene, "leader")
    with Logs("leader", log, log_level) as logs:
        LOG.info("started", extra=details(version=__version__, scene=scene.dump()))
        summary = asyncio.run(_serve(scene, json_lines, logs, realtime))
        LOG.info("summary", extra=details(summary=summary.as_dict()))
    if json_lines:
        write_line("summary", **summary.as_dict())
    else:
        _print_summary(summary)
    write_json(json_file, summary.as_dict())
    if report is not None and scene.recording is not None:
        _write_report(report, scene.recording.file, summary)
    if summary.problem is not None:
        raise MmtError(summary.problem)


async def _serve(scene: Scene, json_lines: bool, logs: Logs, realtime: bool) -> LeaderSummary:
    modelled = scene.texture is not None or scene.rendering is not None
    needs_numerics = modelled or scene.concealment == "model"
    if needs_numerics and not kernels_are_compiled():
        sentence = "compiling the numerics, at the first start only (15 to 60 s)"
        write_line("event", event=sentence) if json_lines else messages.print(sentence)
    from mmt.leader.service import Leader

    service = Leader(
        scene,
        on_status=_write_status if json_lines else _print_status,
        on_event=_write_event if json_lines else _print_event,
    )

    logs.session_id = service.log.session_id

    def ready() -> None:
        if realtime:
            be_real_time()
        service.log.ready_s = round(time.perf_counter() - _STARTED_S, 2)
        where = f"{scene.link.host}:{service.port}" if scene.link is not None else "no link"
        if json_lines:
            write_line("ready", port=service.port, ready_s=service.log.ready_s)
        else:
            messages.print(f"ready after {service.log.ready_s} s: {where}", highlight=False)
            if scene.monitor is not None and scene.link is not None:
                messages.print(
                    f"monitor:  {scene.link.url(service.port)}/monitor/", highlight=False
                )

    stop_on_signals(service.stop)
    if hasattr(signal, "SIGUSR1"):
        asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, service.reset_model)
    running = service.run(ready)
    return await (with_inventory(running) if json_lines else running)


def _write_status(status: LeaderStatus) -> None:
    write_line("status", **status.as_dict())


def _write_event(sentence: str) -> None:
    write_line("event", event=sentence)


def _print_status(status: LeaderStatus) -> None:
    if not messages.is_terminal:
        return
    late = f"{status.tick_p99_ms:.2f}" if status.tick_p99_ms is not None else "-"
    messages.print(
        f"{status.time_s:6.1f} s  {status.mode:11s}  samples {status.samples:4d}  "
        f"{status.completion or 'no model yet'}  lost {status.frames_lost}  tick p99 {late} ms",
        end="\r",
        highlight=False,
    )


def _print_event(sentence: str) -> None:
    messages.print(f"\n{sentence}" if messages.is_terminal else sentence, highlight=False)


def _print_summary(summary: LeaderSummary) -> None:
    from mmt.cli.common import summary_table

    tables: dict[str, Any] = summary.as_dict()
    output.print(summary_table("leader", tables))


def _write_report(directory: Path, recording: Path, summary: LeaderSummary) -> None:
    from mmt.cli.reporting import report_recording

    report_recording(directory, recording, {"leader": summary.as_dict()})
    messages.print(f"report: {directory / 'report.html'}", highlight=False)


def run() -> None:
    """Run ``mmt-leader``."""
    run_app(app, "mmt-leader")


if __name__ == "__main__":
    run()
