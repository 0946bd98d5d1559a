"""``mmt``: sessions, evaluation, benchmarks and the demonstration."""

from pathlib import Path
from typing import Annotated

import typer

from mmt.cli import (
    devices,
    evaluation,
    model_exchange,
    models,
    reports,
    scenes,
    selecting,
    sessions,
)
from mmt.cli.common import messages, run_app, version, write_json
from mmt.core.errors import MmtError

app = typer.Typer(
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
models.app.command("select")(selecting.select_samples)
app.add_typer(scenes.app, name="scene")
app.add_typer(devices.app, name="device")
app.add_typer(reports.app, name="report")

DEFAULT_SCENE = Path("demo")


@app.callback()
def main(
    _: Annotated[
        bool, typer.Option("--version", callback=version, is_eager=True, help="Print it.")
    ] = False,
) -> None:
    """Take the options that stand before a command."""


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
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
    monitor: Annotated[
        bool, typer.Option("--monitor", help="Serve a page that shows the run.")
    ] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Tick by real-time scheduling (Linux).")
    ] = False,
) -> None:
    """Run leader and follower on loopback, then report what was modelled."""
    from mmt.cli.demo import run_demo

    good = run_demo(
        scene_file,
        output_directory,
        duration_s=duration,
        replay=replay,
        json_file=json_file,
        monitor=monitor,
        realtime=realtime,
    )
    if not good:
        raise typer.Exit(1)


@app.command()
def bench(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[burg] [lines] [interpolation] [networks] [synthesis] [update] [order] "
            "[pipeline] [conceal] [contact] [link] [services] [evaluate] [devices]"
        ),
    ] = None,
    duration: Annotated[
        float, typer.Option(help="Seconds for each measurement of link and services.")
    ] = 20.0,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report there.")] = None,
    realtime: Annotated[
        bool,
        typer.Option(
            "--realtime", help="Link: by real-time scheduling. Services: with and without it."
        ),
    ] = False,
) -> None:
    """Measure error against run time on this machine, beside every peer that is installed."""
    from mmt_lab.cli.benching import run_benches

    _, figures = run_benches(what or [], duration, report, realtime=realtime)
    write_json(json_file, figures)
    messages.print("ratios within one run are to be trusted, absolute times are not")
    if "failed" in figures:
        raise MmtError(f"not measured: {', '.join(figures['failed'])}")


@app.command()
def sweep(
    sessions: Annotated[list[Path], typer.Argument(metavar="SESSION...")],
    choices: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE,VALUE", help="Values of a key; repeatable."),
    ] = None,
    scene_file: Annotated[
        Path | None, typer.Option("--scene", help="Take \\[texture] from this scene.")
    ] = None,
    step: Annotated[float, typer.Option(help="Seconds between the rows of an evaluation.")] = 2.5,
    seed: Annotated[int, typer.Option(help="Chooses the segments that are held out.")] = 0,
    workers: Annotated[
        int | None, typer.Option(help="Local processes; as many as there are processors.")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of a Dask cluster's scheduler.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Where the results are kept.")] = Path("mmt-sweep"),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the summary.")] = None,
) -> None:
    """Evaluate every session with every combination of settings; go on where it stopped."""
    from mmt_lab.cli.sweeping import sweep_files

    good = sweep_files(
        sessions,
        choices or [],
        scene_file=scene_file,
        step_s=step,
        seed=seed,
        workers=workers,
        dask=dask,
        out=out,
        json_file=json_file,
    )
    if not good:
        raise typer.Exit(1)


@app.command()
def play(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[MODEL]...", help="Files or names of shipped models; all shipped if absent."
        ),
    ] = None,
    results: Annotated[Path, typer.Option(help="Add the scenarios' rows to this file.")] = Path(
        "mmt-play.csv"
    ),
    record: Annotated[
        Path | None, typer.Option(help="Record touches into this MCAP file, one a texture.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the orders and the excitation.")] = 0,
    host: Annotated[str, typer.Option(help="Listen on this address.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Listen on this port; 0 takes any free one.")] = 8770,
    token_file: Annotated[Path | None, typer.Option(help="A file with the token.")] = None,
    certificate: Annotated[Path | None, typer.Option(help="PEM file: speak TLS.")] = None,
    key: Annotated[Path | None, typer.Option(help="PEM file of the certificate's key.")] = None,
    everyone: Annotated[
        bool, typer.Option("--open", help="Let everyone play who reaches the port.")
    ] = False,
) -> None:
    """Serve a page on which a person strokes textures and hears them."""
    from mmt.cli.playing import play as serve

    serve(
        sources or [],
        results=results,
        record=record,
        seed=seed,
        host=host,
        port=port,
        token_file=token_file,
        certificate=certificate,
        key=key,
        everyone=everyone,
    )


@app.command()
def soak(
    duration: Annotated[float, typer.Option(help="Seconds.")] = 3600.0,
    every: Annotated[float, typer.Option(help="Mean seconds from one fault to the next.")] = 20.0,
    seed: Annotated[int, typer.Option(min=0, help="Of the faults.")] = 1,
    directory: Annotated[Path, typer.Option("--output", help="Where the recording goes.")] = Path(
        "mmt-soak"
    ),
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the figures.")] = None,
) -> None:
    """Run both services for a long time with faults, and check that nothing wears out."""
    from mmt_lab.cli.soaking import run_soak

    if not run_soak(
        duration_s=duration, every_s=every, seed=seed, directory=directory, json_file=json_file
    ):
        raise typer.Exit(1)


@app.command()
def stability(
    families: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ar] [lsf] [model] [contact] [loop] [services]"),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the rows.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report there.")] = None,
) -> None:
    """Run the stiff and extreme cases, a row each, and say whether it held."""
    from mmt_lab.stability.running import run_stability

    if not run_stability(families or [], json_file=json_file, report_to=report):
        raise typer.Exit(1)


def run() -> None:
    """Run ``mmt``."""
    run_app(app, "mmt")


if __name__ == "__main__":
    run()
