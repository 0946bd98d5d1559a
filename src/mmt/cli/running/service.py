"""Run a service, and those beside it, from a command line: options, log, progress, summary."""

import asyncio
import logging
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, Protocol, TypeAlias, TypeVar

import typer

from mmt.cli.common import (
    json_option,
    messages,
    noting,
    output,
    raise_problems,
    require_one_output,
    stop_on_signals,
    summary_table,
    version,
    write_json,
    write_line,
)
from mmt.cli.running.display import StatusLine, print_ending
from mmt.core.errors import MmtError
from mmt.core.extras import __version__, optional_import
from mmt.core.output.logs import Logs, details
from mmt.core.output.streams import drain_output
from mmt.scene import Scene, Service
from mmt.scene.table import Flag, imported

if TYPE_CHECKING:
    from mmt.follower.service import Follower, FollowerSummary
    from mmt.leader.reports import LeaderSummary
    from mmt.leader.service import Leader

SceneFile: TypeAlias = Annotated[
    Path, typer.Argument(metavar="SCENE", help="A TOML file, or an example's name.")
]
Version: TypeAlias = Annotated[
    bool, typer.Option("--version", callback=version, is_eager=True, help="Print the version.")
]


class SideService(Protocol):
    """A service for other people that a command runs beside the leader, such as a page."""

    def start_on_event(self, sentence: str) -> Coroutine[Any, Any, str] | None:
        """Return a coroutine that starts the service on this event of the leader, or None.

        The coroutine returns a text for the terminal.
        """


class LastingSideService(SideService, Protocol):
    """A service that may run longer than the session."""

    @property
    def after_session(self) -> str | None:
        """Words after "until Ctrl-C" on what the service offers after the session, or None."""

    def wait(self) -> None:
        """Wait until the service has ended by itself."""

    def close(self) -> None:
        """End the service."""


def create_side_services(
    flags: Iterable[Flag], scene: Scene, *, terminal: bool = True
) -> list[LastingSideService]:
    """Return the side services of these flags, not started.

    Parameters
    ----------
    flags
        The flags; some have no side service.
    scene
        A scene with the flags' tables.
    terminal
        Whether their texts are shown to a person rather than read by a program.
    """
    return [
        imported(flag.side_service)(scene, terminal=terminal) for flag in flags if flag.side_service
    ]


def start_side_services(
    services: Iterable[SideService], sentence: str, say: Callable[[str], None]
) -> list[asyncio.Task[None]]:
    """Start the services that wait for an event of the leader; `say` is called with their texts."""

    async def start(entering: Coroutine[Any, Any, str]) -> None:
        say(await entering)

    found = [service.start_on_event(sentence) for service in services]
    return [asyncio.create_task(start(entering)) for entering in found if entering is not None]


_LOG = "Progress and log"
AnyService = TypeVar("AnyService", bound="Leader | Follower")


@dataclass(frozen=True)
class ServiceOptions:
    """Options of all services, for `mmt.cli.options.with_options`."""

    json_file: Annotated[Path | None, json_option("Write the summary there.")] = None
    json_lines: Annotated[
        bool,
        typer.Option(
            "--json-lines",
            help="Progress and summary as JSON lines on stdout.",
            rich_help_panel=_LOG,
        ),
    ] = False
    log: Annotated[
        Path | None,
        typer.Option("--log", help="Add a JSON line per event to this file.", rich_help_panel=_LOG),
    ] = None
    log_level: Annotated[
        str | None,
        typer.Option(
            metavar="LEVEL",
            help="Least level of the log: debug, info, warning or error.",
            rich_help_panel=_LOG,
        ),
    ] = None
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Tick by real-time scheduling (Linux).")
    ] = False
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", help="Show what runs, and all counters at the end.", rich_help_panel=_LOG
        ),
    ] = False


class ServiceRun(ABC, Generic[AnyService]):
    """One run of a service, reported as text for people or as JSON lines for a program.

    Parameters
    ----------
    name
        "leader" or "follower".
    scene
        The scene to run.
    options
        Options of the command line.
    """

    def __init__(self, name: Service, scene: Scene, options: ServiceOptions) -> None:
        self.name = name
        self.scene = scene
        self.options = options
        self.line = StatusLine(messages)
        self.problems: list[Exception] = []
        """Errors outside the service, such as of writing; reported at the end."""

    @abstractmethod
    def build(self, logs: Logs) -> AnyService:
        """Return the service; called in the event loop."""

    def on_start(self, service: AnyService) -> None:
        """Handle the start; end signals are already handled."""

    @abstractmethod
    def on_ready(self, service: AnyService) -> None:
        """Report that the service is ready."""

    def on_event(self, sentence: str) -> None:
        """Report an event."""
        if self.options.json_lines:
            write_line("event", event=sentence)
        else:
            self.line.print_line(sentence)

    def evaluate(self, summary: dict[str, Any]) -> tuple[dict[str, Any], Path | None]:
        """Evaluate the recording if requested; return the figures and the report's page."""
        _ = summary
        return {}, None

    def run(self) -> None:
        """Run the service to its end and report its summary.

        Raises
        ------
        InputError
            Two options write to standard output.
        MmtError
            Real-time scheduling is requested but not permitted, or the run failed.
        """
        options, logger = self.options, logging.getLogger(f"mmt.{self.name}")
        require_one_output(options.json_file, json_lines=options.json_lines)
        if options.realtime:
            from mmt.core.running.process import require_real_time

            require_real_time()
        if options.verbose and not options.json_lines:
            _print_parts(self.scene, self.name)
        with Logs(self.name, options.log, options.log_level) as logs, optional_import():
            logger.info("started", extra=details(version=__version__, scene=self.scene.dump()))
            summary = asyncio.run(self._run(logs))
            content = summary.as_dict()
            logger.info("summary", extra=details(summary=content))
        self._end(content)
        with noting(self.problems, "progress cannot be written"):
            drain_output()
        if summary.problem is not None:
            self.problems.append(MmtError(summary.problem))
        raise_problems(self.problems)

    def _end(self, content: dict[str, Any]) -> None:
        """Report a summary in every requested way; an error in one does not prevent the others."""
        self.line.clear()
        options, evaluation, report = self.options, dict[str, Any](), None
        if options.json_lines:
            write_line("summary", **content)
        elif options.verbose:
            output.print(summary_table(self.name, content))
        with noting(self.problems):
            write_json(options.json_file, content)
        with noting(self.problems, "the report"):
            evaluation, report = self.evaluate(content)
        if not options.json_lines:
            called = Path(sys.argv[0]).stem
            program = called if called.startswith("mmt-") else f"mmt-{self.name}"
            print_ending(program, {self.name: content}, evaluation, report)

    async def _run(self, logs: Logs) -> "LeaderSummary | FollowerSummary":
        service = self.build(logs)

        def ready() -> None:
            if self.options.realtime:
                from mmt.core.running.process import be_real_time

                be_real_time()
            self.on_ready(service)

        stop_on_signals(service.stop)
        self.on_start(service)
        try:
            return await service.run(ready)
        finally:
            if self.options.json_lines:
                loaded = [n for n, m in [*sys.modules.items()] if getattr(m, "__spec__", None)]
                write_line("modules", modules=loaded)


def _print_parts(scene: Scene, service: Service) -> None:
    """Print the parts of a service that run, and those that are left out."""
    parts = scene.parts(service)
    running = [name for name, runs in parts.items() if runs]
    left_out = [name for name, runs in parts.items() if not runs]
    messages.print(f"runs:     {', '.join(running) or 'nothing'}")
    messages.print(f"left out: {', '.join(left_out) or 'nothing'}")
    if service == "leader":
        from mmt.cli.scene.description import describe_hand_force

        hand_force = describe_hand_force(scene)
        if hand_force is not None:
            messages.print(f"the hand's force: {hand_force}")
