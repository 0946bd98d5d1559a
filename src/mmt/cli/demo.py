"""``mmt demo``: leader and follower as two processes on loopback, then a report."""

import asyncio
import os
import sys
import threading
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import tomli_w
import typer

from mmt.cli.common import (
    MODEL_NAME,
    OPTIONS,
    Force,
    json_option,
    messages,
    noting,
    output,
    raise_problems,
    summary_table,
    write_json,
)
from mmt.cli.main import GROUP as COMMANDS
from mmt.cli.options import with_flags
from mmt.cli.running.display import command_text, print_ending, telling_of_report
from mmt.cli.running.scene_services import DemoRun, run_services
from mmt.cli.running.service import SceneFile, create_side_services
from mmt.core.errors import InputError, MmtError, naming
from mmt.core.extras import require
from mmt.core.files.existing import free_folder, write_file
from mmt.core.output.streams import hurry_output, queue_output
from mmt.core.plugins import offered
from mmt.core.running.process import require_real_time
from mmt.core.running.programs import on_end_signal
from mmt.devices.drivers import load_device
from mmt.follower.sources import build_source
from mmt.scene import Scene
from mmt.scene.files import find_scene, load_scene
from mmt.scene.table import Flag, added_flags, tables_of
from mmt.testing.emulated.drivers import LabOptions

_EMULATED: Final = {
    "openhaptics": ("virtual-phantom", {"library", "device"}),
    "ati-net-ft": ("virtual-net-ft", {"host", "rdt_port", "http_port"}),
    "adxl335-serial": ("virtual-adxl335", {"port", "baud_rate", "serial"}),
    "haptuator-sound": ("virtual-haptuator-sound", {"device"}),
}
"""By driver: the emulated driver, and options with the device's address, to be removed."""
_NETWORK: Final = {"profile": "wan"}
_HAND, _COIL = "hand.npz", "coil.npz"
"""Files for the emulated hand's motion and the emulated coil's input."""


class SceneFiles(NamedTuple):
    """The scene files of leader and follower."""

    leader: Path
    follower: Path


def pair_named(name: Path) -> SceneFiles | None:
    """Return the scenes ``NAME-leader`` and ``NAME-follower``, or None if they do not exist."""
    for suffix in ("", ".toml"):
        with suppress(InputError):
            return SceneFiles(
                *(find_scene(Path(f"{name}-{side}{suffix}")) for side in SceneFiles._fields)
            )
    return None


def write_emulated(pair: SceneFiles, directory: Path) -> SceneFiles:
    """Write both scenes with emulated devices and network; return the files.

    A scene without ``[network]`` gets the profile ``wan``; ``MMT_NETWORK__PROFILE`` overrides it.

    Raises
    ------
    InputError
        A scene is not valid, has a driver without an emulated device, or cannot be written.
    """
    written = []
    for file in pair:
        tables = _emulated(load_scene(file), directory.resolve())
        target = directory / file.name
        if target.exists() and target.samefile(file):
            raise InputError(f"--output {directory}: the scenes are there; name another folder")
        write_file(target, tomli_w.dumps(tables))
        written.append(target)
    return SceneFiles(*written)


def _emulated(scene: Scene, directory: Path) -> dict[str, Any]:
    tables = scene.dump()
    for key in ("token_file", "certificate", "key", "authority", "host"):
        tables.get("link", {}).pop(key, None)
    tables.setdefault("network", _NETWORK)
    tables.setdefault("recording", {}).update(file=str(directory / "session.mcap"))
    if "handle" in tables:
        tables["handle"] = {**_device(tables["handle"]), "log": str(directory / _HAND)}
    if tables.get("actuator", {}).get("driver"):
        tables["actuator"] = {**_device(tables["actuator"]), "log": str(directory / _COIL)}
    devices = tables.get("devices", {})
    for role in ("robot", "force_sensor", "accelerometer"):
        if role in devices:
            devices[role] = _device(devices[role])
    return tables


def _device(table: dict[str, Any]) -> dict[str, Any]:
    driver = table["driver"]
    if driver not in _EMULATED:
        raise InputError(
            f"the driver {driver} has no emulated device here; {', '.join(_EMULATED)} have one"
        )
    emulated, places = _EMULATED[driver]
    left = {key: value for key, value in table.items() if key not in places}
    return {**left, "driver": emulated}


_NICENESS = 5  # of the thread that imports beside the services


@with_flags("demo")
def demo(
    flags: list[Flag],
    *,
    scene_file: SceneFile = Path("demo"),
    output_directory: Annotated[
        Path, typer.Option("--output", help="Where recording and report go.")
    ] = Path("mmt-demo"),
    duration: Annotated[float | None, typer.Option(help="Seconds of the session.")] = None,
    replay: Annotated[Path | None, typer.Option(help="Replay this recorded session.")] = None,
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None,
    monitor: Annotated[
        bool, typer.Option("--monitor", help="Serve a page that shows the run.")
    ] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Tick by real-time scheduling (Linux).")
    ] = False,
    force: Force = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Show every event, and all counters at the end.")
    ] = False,
) -> None:
    """Run leader and follower on loopback, then report what was modelled.

    With SCENE = NAME, NAME-leader.toml and NAME-follower.toml run with every device emulated.
    """
    if realtime:
        require_real_time()
    if not force:  # do not replace existing files
        output_directory = free_folder(output_directory, MODEL_NAME)
    pair = pair_named(scene_file)
    if pair is not None:
        pair = write_emulated(pair, output_directory)
        scene_file = pair.leader
    recording = output_directory / "session.mcap"
    overrides: dict[str, Any] = {"session.duration_s": duration}
    tables = [*(["monitor"] if monitor else []), *tables_of(flags)]
    given = partial(
        load_scene, scene_file, overrides, replay=replay, tables=tables, options=OPTIONS
    )
    scene = given()
    if scene.link is not None:
        scene = given(record=recording, force=force)
    if scene.numerics:
        require("numba")
    if scene.recording is not None:
        require("matplotlib")
    _check(scene, output_directory)
    having = [flag for flag in added_flags("demo") if {*flag.tables} <= {*scene.added}]
    side_services = create_side_services(having, scene)
    queue_output()
    on_end_signal(_end)
    try:
        run = asyncio.run(
            run_services(
                scene,
                follower_scene=None if pair is None else load_scene(pair.follower, replay=replay),
                realtime=realtime,
                side_services=side_services,
                on_link=_prepare_report if scene.recording is not None else lambda _: None,
                verbose=verbose,
                shows_monitor=sys.stderr.isatty(),
            )
        )
        if run.interrupted and not run.tables():
            raise KeyboardInterrupt
        _report(run, output_directory, recording, pair, json_file, verbose=verbose, play=monitor)
        for service in side_services if not run.interrupted else ():
            if service.after_session is not None:
                with suppress(KeyboardInterrupt):
                    messages.print(f"until Ctrl-C {service.after_session}")
                    service.wait()
    finally:
        for service in side_services:
            service.close()


def _prepare_report(_url: str) -> None:
    """Import what the report needs while the session runs, in a thread behind the services."""
    threading.Thread(target=_import_report, daemon=True).start()


def _import_report() -> None:
    if sys.platform == "linux":
        # not idle priority: on a busy machine the report would wait for the imports for ever
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
    with suppress(ImportError):  # raised again when the report is made
        import mmt.cli.reporting
        import mmt.evaluation.reports.figures  # noqa: F401


def _end() -> None:
    hurry_output()
    raise KeyboardInterrupt


def _report(
    run: DemoRun,
    directory: Path,
    recording: Path,
    pair: SceneFiles | None,
    json_file: Path | None,
    *,
    verbose: bool,
    play: bool,
) -> None:
    """Print the summaries and report the recording; with `play`, print how to play its model.

    Raises
    ------
    MmtError
        A service failed, or something could not be written; everything else is written.
    """
    content: dict[str, Any] = run.tables()
    problems: list[Exception] = []
    with noting(problems, "what the emulated devices did"):
        if pair is not None and (coil := _coil(run, pair)):
            content["coil"] = coil
    if verbose:
        for name, table in content.items():
            output.print(summary_table(name, table))
    model: Path | None = None
    if run.leader.get("recording"):
        with noting(problems, "the report"), telling_of_report(directory, recording):
            from mmt.cli.reporting import report_recording

            content["evaluation"] = report_recording(
                directory, recording, run.tables(), tables=verbose
            )
            model = directory / MODEL_NAME if (directory / MODEL_NAME).exists() else None
    report = directory / "report.html" if "evaluation" in content else None
    if run.leader or run.follower:
        print_ending("mmt demo", run.tables(), content.get("evaluation"), report)
    if play and model is not None and "play" in offered(COMMANDS):
        output.print(f"stroke it yourself:  {command_text('mmt', 'play', model)}")
    with noting(problems):
        write_json(json_file, content)
    raise_problems([*problems, *map(MmtError, run.errors)])


def _coil(run: DemoRun, pair: SceneFiles) -> dict[str, Any]:
    """Return, and print, figures of an emulated actuator's coil; {} if there is none."""
    hand, coil = pair.leader.with_name(_HAND), pair.leader.with_name(_COIL)
    vibration = run.leader.get("vibration", {})
    switches = [each for each in vibration.get("switches", ()) if each["mode"] == "synthesized"]
    devices = load_scene(pair.follower).devices
    if not (hand.exists() and coil.exists() and switches and devices):
        return {}
    from mmt.evaluation.coil import coil_figures
    from mmt.testing.emulated.openhaptics.phantom import ROBOT_N_MM

    robot_n_mm = devices.robot.options.get("stiffness_n_mm", ROBOT_N_MM)
    since_s = run.leader["session"]["duration_s"] - switches[-1]["time_s"]
    latency_ms = vibration["actuator"]["latency_ms"] or 0.0
    figures = coil_figures(hand, coil, LabOptions().surface, robot_n_mm, since_s, latency_ms)
    if "begin_ms" in figures:
        output.print(
            "at the coil: vibration begins {begin_ms:+.1f} ms and ends {end_ms:+.1f} ms after the "
            "hand's own contact, beyond the output's {output_latency_ms:.1f} ms; level "
            "{level_error_db:+.1f} dB".format_map(figures)
        )
    return figures


def _check(scene: Scene, directory: Path) -> None:
    """Check that devices, source and output folder can be used, before the services start.

    Logs of an earlier run's emulated devices are removed.
    """
    if scene.source is not None:
        build_source(scene).close()
    if scene.handle is not None:
        load_device(scene.handle.driver, scene.handle.options, role="handle").close()
    if scene.actuator is not None and scene.actuator.driver is not None:
        load_device(scene.actuator.driver, scene.actuator.options, role="actuator").close()
    with naming(f"--output {directory}"):
        directory.mkdir(parents=True, exist_ok=True)
        for earlier in (_HAND, _COIL):
            (directory / earlier).unlink(missing_ok=True)
