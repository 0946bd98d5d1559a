"""Run a scene's services as two processes on loopback."""

import asyncio
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import tomli_w
from rich.console import Console

from mmt.cli.common import messages, open_page, stopping_on_signals
from mmt.cli.running.child import Child
from mmt.cli.running.display import StatusLine
from mmt.cli.running.service import SideService, start_side_services
from mmt.core.files.existing import write_file
from mmt.scene import Scene
from mmt.scene.files import ENVIRONMENT_PREFIX

_LAST_SECONDS: Final = 5.0
_LONGEST_OPENING_S: Final = 10.0
"""Longest wait for a browser to open the monitor before the session begins."""
_LONGEST_START_S: Final = 30.0
"""Longest wait after a short session until side services are up, or say why they are not."""


@dataclass
class DemoRun:
    """Summaries and errors of the two services."""

    leader: dict[str, Any] = field(default_factory=dict)
    follower: dict[str, Any] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    failed: bool = False
    interrupted: bool = False
    start_s: dict[str, float] = field(default_factory=dict)
    """By service: time from the start of its process until it was ready."""
    modules: dict[str, list[str]] = field(default_factory=dict)
    """By service: the modules that it has imported at its end."""

    def tables(self) -> dict[str, Any]:
        """Return the received summaries by service."""
        both = {"leader": self.leader, "follower": self.follower}
        return {name: table for name, table in both.items() if table}


async def run_services(
    scene: Scene,
    *,
    follower_scene: Scene | None = None,
    console: Console = messages,
    environment: Mapping[str, str] = os.environ,
    realtime: bool = False,
    side_services: Sequence[SideService] = (),
    on_link: Callable[[str], None] = lambda _: None,
    verbose: bool = False,
    shows_monitor: bool = False,
) -> DemoRun:
    """Run the services of a scene as processes until both have ended.

    Parameters
    ----------
    scene
        The resolved scene; the services get it in a file, and any free port.
    follower_scene
        The follower's scene, if it differs from the leader's.
    console
        Console for the live progress.
    environment
        Environment of the processes, without settings of scenes: these are resolved already.
    realtime
        Whether the services tick by real-time scheduling.
    side_services
        Side services, which start at events of the leader.
    on_link
        Called with the URL of the leader's link when the leader listens.
    verbose
        Whether to print every event of both services.
    shows_monitor
        Whether to open the scene's monitor in a browser, and wait for it before the session begins.
    """
    with tempfile.TemporaryDirectory(prefix="mmt-") as directory:
        files = []
        for name, each in (("leader", scene), ("follower", follower_scene or scene)):
            files.append(Path(directory) / f"{name}.toml")
            write_file(files[-1], tomli_w.dumps(each.dump()))
        shared = ["--json-lines", *["--realtime"] * realtime]
        return await _Services(
            scene,
            [str(files[0]), *shared, *(["--port", "0"] if scene.link is not None else [])],
            [str(files[1]), *shared],
            {name: v for name, v in environment.items() if not _sets_scene(name)},
            side_services,
            on_link,
            StatusLine(console),
            verbose=verbose,
            shows_monitor=shows_monitor,
        ).run()


def _sets_scene(variable: str) -> bool:
    """Return whether a variable overrides a scene; it would add a table again that is left out."""
    return variable.startswith(ENVIRONMENT_PREFIX) and "__" in variable


@dataclass
class _Services:
    scene: Scene
    leader_arguments: list[str]
    follower_arguments: list[str]
    environment: Mapping[str, str]
    side_services: Sequence[SideService]
    on_link: Callable[[str], None]
    line: StatusLine
    verbose: bool
    shows_monitor: bool
    found: DemoRun = field(default_factory=DemoRun)
    starting: list[asyncio.Task[None]] = field(default_factory=list)
    children: list[Child] = field(default_factory=list)
    begun: bool = False
    page_until_s: float = 0.0

    async def run(self) -> DemoRun:
        with stopping_on_signals(self._interrupt):
            try:
                self.line.show({}, "starting")
                leader = await self._start("leader", self.leader_arguments)
                await self._watch_leader(leader)
                if self.starting and not self.found.interrupted:
                    await asyncio.wait(self.starting, timeout=_LONGEST_START_S)
            finally:
                self.line.clear()
                for entering in self.starting:
                    entering.cancel()
                await asyncio.gather(*(child.kill() for child in self.children))
        return self.found

    async def _start(self, name: str, arguments: list[str]) -> Child:
        child = await Child.start(
            name,
            "mmt.cli.running.child",
            [name, *arguments],
            self.environment,
            lambda sentence: self.line.print_line(f"{name}: {sentence}"),
        )
        self.children.append(child)
        if self.found.interrupted:
            child.interrupt()
        return child

    def _interrupt(self) -> None:
        self.found.interrupted = True
        for entering in self.starting:
            entering.cancel()
        for child in self.children:
            child.interrupt()

    async def _watch_leader(self, leader: Child) -> None:
        follower: Child | None = None
        url = ""
        async for line in leader.lines():
            self._take(leader, line)
            self._take_leader(line)
            if line["kind"] == "ready" and self.scene.link is not None:
                url = self.scene.link.url(line["port"])
                self.on_link(url)
                if self.scene.monitor is not None:
                    self.line.print_line(f"monitor: {url}/monitor/")
                    if self.shows_monitor and open_page(f"{url}/monitor/"):
                        self.page_until_s = leader.age_s + _LONGEST_OPENING_S
            if url and follower is None and not self._awaits_page(leader, line):
                follower = await self._start(
                    "follower", [*self.follower_arguments, "--leader", url]
                )
                following = asyncio.create_task(self._watch_follower(follower, leader))
        failed = await self._note_end(leader) != 0
        if follower is not None:
            await asyncio.wait([following], timeout=0.0 if failed else _LAST_SECONDS)
            follower.interrupt()  # else the follower would wait for the ended leader
            await asyncio.wait([following], timeout=_LAST_SECONDS)
            await follower.kill()
            await following

    def _awaits_page(self, leader: Child, line: Mapping[str, Any]) -> bool:
        """Return whether to wait for the browser, so that the page shows the beginning."""
        return leader.age_s < self.page_until_s and not line.get("viewers")

    async def _watch_follower(self, follower: Child, leader: Child) -> None:
        async for line in follower.lines():
            self._take(follower, line)
            if line["kind"] == "event" and self.verbose:
                self.line.print_line(f"follower: {line['event']}")
            elif line["kind"] == "summary":
                self.found.follower = {key: v for key, v in line.items() if key != "kind"}
        if await self._note_end(follower) != 0:
            leader.interrupt()  # else the leader would wait for the ended follower

    async def _note_end(self, child: Child) -> int:
        code = await child.wait()
        if code != 0:
            self.found.failed = True
            self.found.errors.append(f"{child.name} ended with exit code {code}: {child.messages}")
        return code

    def _take(self, child: Child, line: dict[str, Any]) -> None:
        if line["kind"] == "ready":
            self.found.start_s[child.name] = child.age_s
        elif line["kind"] == "modules":
            self.found.modules[child.name] = line["modules"]

    def _take_leader(self, line: dict[str, Any]) -> None:
        kind = line["kind"]
        if kind == "status":
            self.line.show(line["verdict"])
        elif kind == "event":
            if self.verbose or not self.begun:  # early events, such as of compiling
                self.line.print_line(f"leader: {line['event']}")
            say = self.line.print_line
            self.starting += start_side_services(self.side_services, line["event"], say)
        elif kind == "ready":
            self.begun = True
        elif kind == "summary":
            self.found.leader = {key: value for key, value in line.items() if key != "kind"}
