"""``mmt demo``: leader and follower as two processes on loopback, then a report."""

import asyncio
import json
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from mmt.cli.common import messages, output, write_json
from mmt.cli.tables import summary_table
from mmt.errors import MmtError
from mmt.scene import Scene
from mmt.scene_files import load_scene

_LAST_SECONDS: Final = 5.0


@dataclass
class DemoRun:
    """What the two services said of themselves."""

    leader: dict[str, Any] = field(default_factory=dict)
    follower: dict[str, Any] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    failed: bool = False

    def tables(self) -> dict[str, Any]:
        """Return the summaries that arrived."""
        return {
            name: table
            for name, table in (("leader", self.leader), ("follower", self.follower))
            if table
        }


def run_demo(
    scene_file: Path,
    directory: Path,
    *,
    duration_s: float | None = None,
    replay: Path | None = None,
    json_file: Path | None = None,
) -> bool:
    """Run a scene's services, print their summaries, and report the recording.

    Returns
    -------
    bool
        Whether everything ended as wanted.
    """
    recording = directory / "session.mcap"
    overrides: dict[str, Any] = {"session.duration_s": duration_s}
    scene = load_scene(scene_file, overrides, replay=replay)
    if scene.link is not None:
        overrides["recording.file"] = str(recording)
        scene = load_scene(scene_file, overrides, replay=replay)
    directory.mkdir(parents=True, exist_ok=True)
    run = asyncio.run(run_services(scene_file, scene, duration_s, replay))
    for name, table in run.tables().items():
        output.print(summary_table(name, table))
    for error in run.errors:
        messages.print(f"[red]error:[/] {error}", highlight=False)
    content: dict[str, Any] = run.tables()
    if scene.recording is not None and recording.exists():
        from mmt.cli.reporting import report_recording

        content["evaluation"] = report_recording(directory, recording, run.tables())
        messages.print(f"recording: {recording}", highlight=False)
        messages.print(f"report:    {directory / 'report.html'}", highlight=False)
    write_json(json_file, content)
    return not run.failed


async def run_services(
    scene_file: Path, scene: Scene, duration_s: float | None, replay: Path | None
) -> DemoRun:
    """Run the services of a scene as processes, with live progress, until both have ended."""
    return await _Demo(scene_file, scene, duration_s, replay).run()


class _Demo:
    def __init__(
        self, scene_file: Path, scene: Scene, duration_s: float | None, replay: Path | None
    ) -> None:
        self._scene = scene
        self._run = DemoRun()
        self._arguments = [str(scene_file)]
        if replay is not None:
            self._arguments += ["--replay", str(replay)]
        self._leader_arguments = [*self._arguments, "--json-lines"]
        if duration_s is not None:
            self._leader_arguments += ["--duration", str(duration_s)]
        if scene.link is not None:
            self._leader_arguments += ["--port", "0"]
        if scene.recording is not None:
            self._leader_arguments += ["--record", str(scene.recording.file)]
        self._progress = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=24),
            TextColumn("{task.fields[status]}"),
            TimeElapsedColumn(),
            console=messages,
        )

    async def run(self) -> DemoRun:
        processes: list[asyncio.subprocess.Process] = []
        loop = asyncio.get_running_loop()
        with suppress(NotImplementedError):  # Windows passes Ctrl-C to the children by itself
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, self._interrupt, processes)
        with self._progress:
            leader = await self._start("mmt.cli.leader", self._leader_arguments)
            processes.append(leader)
            watching: list[asyncio.Task[None]] = []
            bar = self._progress.add_task(
                "leader", total=self._scene.session.duration_s, status="starting"
            )
            async for line in _lines(leader):
                self._take_leader(line, bar)
                if line["kind"] == "ready" and self._scene.link is not None:
                    url = f"http://{self._scene.link.host}:{line['port']}"
                    follower = await self._start(
                        "mmt.cli.follower", [*self._arguments, "--leader", url, "--json-lines"]
                    )
                    processes.append(follower)
                    watching.append(asyncio.create_task(self._watch_follower(follower, leader)))
            await leader.wait()
            for task in watching:
                await asyncio.wait_for(task, _LAST_SECONDS)
        await self._collect(processes)
        return self._run

    async def _start(self, module: str, arguments: list[str]) -> asyncio.subprocess.Process:
        return await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            module,
            *arguments,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=os.name == "posix",
        )

    @staticmethod
    def _interrupt(processes: list[asyncio.subprocess.Process]) -> None:
        for process in processes:
            if process.returncode is None:
                process.send_signal(signal.SIGINT)

    def _take_leader(self, line: dict[str, Any], bar: Any) -> None:
        kind = line.pop("kind")
        line["kind"] = kind
        if kind == "status":
            self._progress.update(bar, completed=line["time_s"], status=status_text(line))
        elif kind == "event":
            self._progress.console.print(f"leader: {line['event']}", highlight=False)
        elif kind == "ready":
            self._progress.update(bar, status=f"ready after {line['ready_s']} s")
        elif kind == "summary":
            self._run.leader = {key: value for key, value in line.items() if key != "kind"}
            self._progress.update(bar, completed=self._run.leader["session"]["duration_s"])

    async def _watch_follower(
        self, follower: asyncio.subprocess.Process, leader: asyncio.subprocess.Process
    ) -> None:
        async for line in _lines(follower):
            if line["kind"] == "event":
                self._progress.console.print(f"follower: {line['event']}", highlight=False)
            elif line["kind"] == "summary":
                self._run.follower = {key: v for key, v in line.items() if key != "kind"}
        if await follower.wait() != 0 and leader.returncode is None:
            leader.send_signal(signal.SIGINT)  # without a follower it would wait in vain

    async def _collect(self, processes: list[asyncio.subprocess.Process]) -> None:
        for name, process in zip(("leader", "follower"), processes, strict=False):
            code = await process.wait()
            text = (await process.stderr.read()).decode() if process.stderr else ""
            if code != 0:
                self._run.failed = True
                self._run.errors.append(f"{name} ended with exit code {code}: {text.strip()}")


async def _lines(process: asyncio.subprocess.Process) -> AsyncIterator[dict[str, Any]]:
    assert process.stdout is not None  # noqa: S101 - it was asked for
    async for raw in process.stdout:
        try:
            yield json.loads(raw)
        except ValueError as error:
            raise MmtError(f"a service printed {raw!r} instead of a JSON line") from error


def status_text(status: dict[str, Any]) -> str:
    """Return the live line: mode, samples, distance, frames lost, tick jitter."""
    distance = status["distance"]
    late = status["tick_p99_ms"]
    return (
        f"{status['time_s']:5.1f} s  {status['mode']:<11}  samples {status['samples']:3d}  "
        f"distance {'-' if distance is None else format(distance, '.2f')}  "
        f"lost {status['frames_lost']}  "
        f"tick p99 {'-' if late is None else format(late, '.2f')} ms"
    )
