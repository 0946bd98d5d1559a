"""``mmt``: sessions, evaluation, models, devices, scenes and the demonstration."""

from collections.abc import Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from mmt.cli import (
    devices,
    evaluation,
    model_exchange,
    model_store,
    models,
    scenes,
    selecting,
    sessions,
    surfaces,
)
from mmt.cli.common import Force, json_option, run_app, version

COMMANDS = "mmt.commands"
"""The entry points by which other packages add commands: the name, and a `typer.Typer`."""


class Commands(TyperGroup):
    """The commands of this package, and those that others add, loaded when they are asked for."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return [*super().list_commands(ctx), *_added()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by its name, None where there is none."""
        own = super().get_command(ctx, cmd_name)
        if own is not None or cmd_name not in _added():
            return own
        command = typer.main.get_command(_added()[cmd_name].load())
        command.name = cmd_name
        return command


@cache
def _added() -> Mapping[str, EntryPoint]:
    return {each.name: each for each in entry_points(group=COMMANDS)}


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Model-mediated teleoperation of haptic texture.",
)
app.command()(evaluation.evaluate)
app.add_typer(sessions.app, name="session")
app.add_typer(models.app, name="model")
models.app.command("import")(model_exchange.import_model)
models.app.command("export")(model_exchange.export_model)
models.app.command("list")(model_store.list_models)
models.app.command("push")(model_store.push)
models.app.command("pull")(model_store.pull)
models.app.command("select")(selecting.select_samples)
app.command("surface")(surfaces.say_surface)
app.add_typer(scenes.app, name="scene")
app.add_typer(devices.app, name="device")
app.add_typer(evaluation.reports, name="report")

DEFAULT_SCENE = Path("demo")


@app.callback()
def main(
    _: Annotated[
        bool, typer.Option("--version", callback=version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Handle the options that precede a command."""


@app.command()
def demo(
    scene_file: Annotated[
        Path, typer.Argument(metavar="SCENE", help="A TOML file, or an example's name.")
    ] = DEFAULT_SCENE,
    output_directory: Annotated[
        Path, typer.Option("--output", help="Where recording and report go.")
    ] = Path("mmt-demo"),
    duration: Annotated[float | None, typer.Option(help="Seconds of the session.")] = None,
    replay: Annotated[Path | None, typer.Option(help="Replay this recorded session.")] = None,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
    monitor: Annotated[
        bool, typer.Option("--monitor", help="Serve a page that shows the run.")
    ] = False,
    share: Annotated[
        bool, typer.Option("--share", help="Let others feel the surface: share the model.")
    ] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Tick by real-time scheduling (Linux).")
    ] = False,
    force: Force = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Show all counters at the end.")
    ] = False,
) -> None:
    """Run leader and follower on loopback, then report what was modelled."""
    from mmt.cli.demo import run_demo

    run_demo(
        scene_file,
        output_directory,
        duration_s=duration,
        replay=replay,
        json_file=json_file,
        monitor=monitor,
        share=share,
        realtime=realtime,
        force=force,
        verbose=verbose,
    )


@app.command()
def play(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MODEL]...", help="Files or names of shipped models; all shipped if absent."
        ),
    ] = None,
    shared: Annotated[
        str | None,
        typer.Option("--from", metavar="URL", help="Play the model that a leader shares there."),
    ] = None,
    results: Annotated[Path, typer.Option(help="Add the scenarios' rows to this file.")] = Path(
        "mmt-play.csv"
    ),
    record: Annotated[
        Path | None, typer.Option(help="Record touches into this MCAP file, one a texture.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the orders and the excitation.")] = 0,
    host: Annotated[str, typer.Option(help="Listen on this address.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Listen on this port; 0 takes any free one.")] = 8770,
    token_file: Annotated[Path | None, typer.Option(help="A file with the token.")] = None,
    certificate: Annotated[Path | None, typer.Option(help="PEM file: use TLS.")] = None,
    key: Annotated[Path | None, typer.Option(help="PEM file of the certificate's key.")] = None,
    everyone: Annotated[
        bool, typer.Option("--open", help="Let everyone play who reaches the port.")
    ] = False,
    force: Force = False,
) -> None:
    """Serve a page on which a person strokes textures and hears them."""
    from mmt.cli.playing import play as serve

    serve(
        sources or [],
        shared=shared,
        results=results,
        record=record,
        seed=seed,
        host=host,
        port=port,
        token_file=token_file,
        certificate=certificate,
        key=key,
        everyone=everyone,
        force=force,
    )


@app.command()
def hub(
    url: Annotated[str, typer.Argument(help="Where the leader shares its model.")],
    scene_file: Annotated[
        Path | None,
        typer.Argument(metavar="[SCENE]", help="Tables hub, sharing, listening: a TOML file."),
    ] = None,
    redis: Annotated[
        str | None, typer.Option(metavar="URL", help="The Redis server that joins the hubs.")
    ] = None,
    address: Annotated[
        str | None, typer.Option(metavar="URL", help="Where listeners reach this hub.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(help="Listen on this port; 0 takes any free one.")
    ] = None,
    duration: Annotated[float | None, typer.Option(min=0.0, help="Seconds to serve.")] = None,
    json_file: Annotated[Path | None, json_option("Write the summary.")] = None,
    json_lines: Annotated[
        bool, typer.Option("--json-lines", help="Progress and summary as JSON lines on stdout.")
    ] = False,
) -> None:
    """Serve a leader's shared model to any number of listeners, together with other hubs."""
    from mmt.cli.hub import run_hub

    overrides = {
        "listening.url": url,
        "hub.redis": redis,
        "hub.address": address,
        "sharing.port": port,
    }
    run_hub(scene_file, overrides, duration, json_file, json_lines=json_lines)


def run() -> None:
    """Run ``mmt``."""
    run_app(app, "mmt")


if __name__ == "__main__":
    run()
