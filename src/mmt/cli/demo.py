"""``mmt demo``: leader and follower as two processes on loopback, then a report."""

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Any

from mmt.cli.common import (
    OPTIONS,
    messages,
    noting,
    output,
    raise_problems,
    summary_table,
    write_json,
)
from mmt.cli.ending import ending_lines
from mmt.cli.scene_services import DemoRun, run_services
from mmt.cli.visiting import visitors_page
from mmt.core.errors import InputError, MmtError
from mmt.core.existing_files import free_path
from mmt.core.extras import require
from mmt.core.realtime import require_real_time
from mmt.devices.drivers import load_device
from mmt.follower.sources import build_source
from mmt.scene import Scene
from mmt.scene.files import load_scene


def run_demo(
    scene_file: Path,
    directory: Path,
    *,
    duration_s: float | None = None,
    replay: Path | None = None,
    json_file: Path | None = None,
    monitor: bool = False,
    share: bool = False,
    realtime: bool = False,
    force: bool = False,
    verbose: bool = False,
) -> None:
    """Run a scene's services, print their summaries, and report the recording.

    A recording that is there already stays, and the new one gets a number; with `force` it is
    replaced. The report is of the newest.

    Raises
    ------
    InputError
        The scene, the session to replay or the directory cannot be used, or a package that the
        report needs is not installed.
    MmtError
        Real-time scheduling is wanted and not permitted, or a service failed; summaries, report
        and JSON are there nevertheless, as far as they can be.
    """
    if realtime:
        require_real_time()
    wanted = directory / "session.mcap"
    recording = wanted if force else free_path(wanted)
    overrides: dict[str, Any] = {"session.duration_s": duration_s}
    scene = load_scene(
        scene_file, overrides, replay=replay, monitor=monitor, share=share, options=OPTIONS
    )
    if scene.link is not None:
        scene = load_scene(
            scene_file,
            overrides,
            replay=replay,
            record=recording,
            force=force,
            monitor=monitor,
            share=share,
            options=OPTIONS,
        )
    if scene.numerics:
        require("numba")
    if scene.recording is not None:
        require("matplotlib")
    _check(scene, directory)
    page = None if scene.sharing is None else visitors_page(scene.sharing)
    try:
        run = asyncio.run(
            run_services(scene_file, scene, duration_s, replay, realtime=realtime, visitors=page)
        )
        _report(run, directory, recording, json_file, verbose=verbose)
        if page is not None and page.address is not None and not run.interrupted:
            with suppress(KeyboardInterrupt):
                messages.print(f"until Ctrl-C it can be felt at {page.address}", highlight=False)
                page.wait()
    finally:
        if page is not None:
            page.close()


def _report(
    run: DemoRun,
    directory: Path,
    recording: Path,
    json_file: Path | None,
    *,
    verbose: bool,
) -> None:
    """Print the summaries, and report the recording.

    Raises
    ------
    MmtError
        A service failed, or something could not be written; the rest is there nevertheless.
    """
    content: dict[str, Any] = run.tables()
    if verbose:
        for name, table in content.items():
            output.print(summary_table(name, table))
    problems: list[Exception] = []
    if run.leader.get("recording"):
        from mmt.cli.reporting import report_recording

        with noting(problems, "the report"):
            content["evaluation"] = report_recording(
                directory, recording, run.tables(), tables=verbose
            )
    report = directory / "report.html" if "evaluation" in content else None
    if run.leader or run.follower:
        for line in ending_lines(run.tables(), content.get("evaluation"), report):
            output.print(line, highlight=False, soft_wrap=True)
    with noting(problems):
        write_json(json_file, content)
    raise_problems([*problems, *map(MmtError, run.errors)])


def _check(scene: Scene, directory: Path) -> None:
    """Find out what the services cannot use, and where nothing can be written, beforehand."""
    if scene.source is not None:
        build_source(scene).close()
    if scene.handle is not None:
        load_device(scene.handle.driver, scene.handle.options, role="handle").close()
    if scene.actuator is not None and scene.actuator.driver is not None:
        load_device(scene.actuator.driver, scene.actuator.options, role="actuator").close()
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--output {directory}: {error.strerror or error}") from error
