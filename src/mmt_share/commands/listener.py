"""``mmt-listen``: another hand on the same surface."""

from pathlib import Path
from typing import Annotated, Final

import typer

from mmt.cli.common import OPTIONS, run_app
from mmt.cli.leader import LeaderRun
from mmt.cli.options import with_options
from mmt.cli.running.service import ServiceOptions, Version
from mmt.core.errors import InputError
from mmt.scene.files import load_scene

_OPTIONS: Final = {**OPTIONS, "listening.url": "URL", "listening.name": "--name"}

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
@with_options
def listen(
    url: Annotated[str, typer.Argument(help="Where the leader shares its model.")],
    *,
    scene_file: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE", help="This side's hand and actuator: a TOML file, or an example."
        ),
    ] = Path("listener"),
    name: Annotated[str | None, typer.Option(help="What the leader calls this listener.")] = None,
    control: Annotated[
        bool, typer.Option("--control", help="Ask for control of the leader's robot.")
    ] = False,
    duration: Annotated[float | None, typer.Option(help="Seconds to listen.")] = None,
    options: ServiceOptions,
    _: Version = False,
) -> None:
    """Feel the surface that a leader shares: its model, rendered here from this hand's motion."""
    overrides = {"listening.url": url, "listening.name": name, "session.duration_s": duration}
    scene = load_scene(
        scene_file, overrides, tables=["operating"] if control else [], options=_OPTIONS
    )
    if scene.link is not None:
        raise InputError("a listener has no follower: leave [link] out of the scene")
    from mmt.link.connection import check_url

    check_url(url)  # before kernels are compiled
    LeaderRun(scene, options, None).run()


def run() -> None:
    """Run ``mmt-listen``."""
    run_app(app, "mmt-listen")
