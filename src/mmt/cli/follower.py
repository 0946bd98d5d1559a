"""``mmt-follower``: measure and stream."""

from pathlib import Path
from typing import Annotated

import typer

from mmt.cli.common import OPTIONS, run_app, write_line
from mmt.cli.options import with_options
from mmt.cli.running.service import SceneFile, ServiceOptions, ServiceRun, Version
from mmt.core.errors import InputError
from mmt.core.output.logs import Logs
from mmt.core.output.streams import queue_output
from mmt.follower.service import Follower
from mmt.scene import Scene
from mmt.scene.files import load_scene

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
@with_options
def follower(
    scene_file: SceneFile,
    *,
    leader: Annotated[
        str | None, typer.Option(metavar="URL", help="The leader; the scene's \\[link] if absent.")
    ] = None,
    replay: Annotated[Path | None, typer.Option(help="Replay this recorded session.")] = None,
    speed: Annotated[
        float | None, typer.Option(help="Replay this many times faster than real time.")
    ] = None,
    options: ServiceOptions,
    _: Version = False,
) -> None:
    """Stream one session: read the scene's source and send it to the leader."""
    scene = load_scene(scene_file, replay=replay)
    if speed is not None:
        if scene.replay is None:
            raise InputError("--speed is for a replay: give --replay FILE, or a scene of one")
        overrides = {"replay.speed": speed}
        scene = load_scene(scene_file, overrides, replay=replay, options=OPTIONS)
    queue_output()
    FollowerRun(scene, options, leader).run()


class FollowerRun(ServiceRun[Follower]):
    """One run of the follower.

    Parameters
    ----------
    scene
        The scene to run.
    options
        Options of the command line.
    url
        URL of the leader; None takes the scene's.
    """

    def __init__(self, scene: Scene, options: ServiceOptions, url: str | None) -> None:
        super().__init__("follower", scene, options)
        self._url = url

    def build(self, logs: Logs) -> Follower:
        """Return the follower; log lines have the session's id once it is known."""

        def on_session(session_id: str) -> None:
            logs.session_id = session_id

        return Follower(self.scene, self._url, on_event=self.on_event, on_session=on_session)

    def on_start(self, service: Follower) -> None:
        """Report the source that is streamed, and the robot's limits."""
        self.on_event(service.source.describe())
        limits = self.scene.describe_motion_limits()
        if limits is not None:
            self.on_event(f"the robot's limits: {limits}")

    def on_ready(self, service: Follower) -> None:
        """Report that the leader is connected."""
        _ = service
        if self.options.json_lines:
            write_line("ready")


def run() -> None:
    """Run ``mmt-follower``."""
    run_app(app, "mmt-follower")
