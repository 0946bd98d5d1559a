"""``mmt-leader``: model and render."""

import asyncio
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from mmt.cli.common import MODEL_NAME, OPTIONS, Force, run_app, write_line
from mmt.cli.options import with_flags, with_options
from mmt.cli.running.display import telling_of_report
from mmt.cli.running.service import (
    LastingSideService,
    SceneFile,
    ServiceOptions,
    ServiceRun,
    Version,
    create_side_services,
    start_side_services,
)
from mmt.core.errors import InputError
from mmt.core.extras import require
from mmt.core.files.existing import free_folder
from mmt.core.kernel_cache import compile_kernels
from mmt.core.output.logs import Logs
from mmt.core.output.streams import is_behind, queue_output
from mmt.leader.modelling.process import ModellingProcess
from mmt.leader.parts import numerics_of
from mmt.leader.reports import LeaderStatus
from mmt.scene import Scene
from mmt.scene.files import load_scene
from mmt.scene.table import Flag, tables_of

if TYPE_CHECKING:
    from mmt.leader.service import Leader

_STARTED_S: Final = time.perf_counter()

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
@with_flags("leader")
@with_options
def leader(
    scene_file: SceneFile,
    *,
    flags: list[Flag],
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
    options: ServiceOptions,
    monitor: Annotated[
        bool, typer.Option("--monitor", help="Serve a page that shows the run.")
    ] = False,
    force: Force = False,
    _: Version = False,
) -> None:
    """Serve one session: receive the follower's stream, model the texture, render it."""
    overrides = {
        "session.duration_s": duration,
        "link.port": port,
        "rendering.model": str(model) if model else None,
    }
    scene = load_scene(
        scene_file,
        overrides,
        replay=replay,
        record=record,
        force=force,
        tables=[*(["monitor"] if monitor else []), *tables_of(flags)],
        options=OPTIONS,
    )
    side_services = create_side_services(flags, scene, terminal=not options.json_lines)
    if report is not None and scene.recording is None:
        raise InputError("--report needs a recording: give --record FILE or add [recording]")
    if report is not None:
        require("matplotlib")
        report = report if force else free_folder(report, MODEL_NAME)
    LeaderRun(scene, options, report, side_services).run()


class LeaderRun(ServiceRun["Leader"]):
    """One run of the leader.

    Parameters
    ----------
    scene
        The scene to run.
    options
        Options of the command line.
    report
        Directory for a report of the recording, or None.
    side_services
        Side services, which start at events of the leader.
    """

    def __init__(
        self,
        scene: Scene,
        options: ServiceOptions,
        report: Path | None,
        side_services: Sequence[LastingSideService] = (),
    ) -> None:
        super().__init__("leader", scene, options)
        self._report = report
        self._side_services = side_services
        self._entering: list[asyncio.Task[None]] = []
        self._modelling = ModellingProcess.from_scene(scene)

    def run(self) -> None:
        """Compile the numerics if needed, and run the leader; see `ServiceRun.run`."""
        queue_output()
        try:
            others: list[str] = []
            if self._modelling is not None:
                self._modelling.launch()  # early, so that both processes import at the same time
                others = self._modelling.factory.numerics
            if numerics := numerics_of(self.scene):
                compile_kernels(numerics, super().on_event, others)
            super().run()
        finally:
            if self._modelling is not None:
                self._modelling.close()
            for service in self._side_services:
                service.close()

    def build(self, logs: Logs) -> "Leader":
        """Return the leader."""
        from mmt.leader.service import Leader

        service = Leader(
            self.scene,
            on_status=self.on_status,
            on_event=self.on_event,
            modelling=self._modelling,
        )
        logs.session_id = service.log.session_id
        return service

    def on_start(self, service: "Leader") -> None:
        """Set signal handlers: SIGUSR1 resets the model, and parts may handle other signals."""
        loop, acts = asyncio.get_running_loop(), {"SIGUSR1": service.reset_model}
        for signals in service.parts.verbs("signals"):
            acts |= signals()
        for name, act in acts.items():
            if hasattr(signal, name):
                loop.add_signal_handler(getattr(signal, name), act)

    def on_ready(self, service: "Leader") -> None:
        """Report the time since the start of the program, and the addresses."""
        ready_s = service.log.ready_s = round(time.perf_counter() - _STARTED_S, 2)
        if self.options.json_lines:
            write_line("ready", port=service.port, ready_s=ready_s)
            return
        link = self.scene.link
        where = f"{link.host}:{service.port}" if link is not None else "no link"
        self.line.print_line(f"ready after {ready_s} s: {where}")
        if self.scene.monitor is not None and link is not None:
            self.line.print_line(f"monitor:  {link.url(service.port)}/monitor/")

    def on_status(self, status: LeaderStatus) -> None:
        """Report progress: a JSON line, or the status line of the terminal."""
        if not self.options.json_lines:
            self.line.show(status.verdict)
        elif not is_behind(sys.stdout):
            write_line("status", **status.as_dict())

    def on_event(self, sentence: str) -> None:
        """Report an event, and start the side services that wait for it."""
        super().on_event(sentence)
        self._entering += start_side_services(self._side_services, sentence, self.on_event)

    def evaluate(self, summary: dict[str, Any]) -> tuple[dict[str, Any], Path | None]:
        """Write the report of the recording, if requested; return its figures and its page."""
        if self._report is None or "recording" not in summary:  # it ended before it was ready
            return {}, None
        options, file = self.options, Path(summary["recording"]["file"])
        tables = options.verbose and not options.json_lines
        with telling_of_report(self._report, file):
            from mmt.cli.reporting import report_recording

            figures = report_recording(self._report, file, {"leader": summary}, tables=tables)
        return figures, self._report / "report.html"


def run() -> None:
    """Run ``mmt-leader``."""
    run_app(app, "mmt-leader")
