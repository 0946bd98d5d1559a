"""Options of ``mmt device equalise``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from mmt.cli.common import Force, json_option


@dataclass(frozen=True)
class EqualisingOptions:
    """Options of the fit, of a sweep that is played now, and of what is stored."""

    serial: Annotated[
        str | None,
        typer.Option(help="Store it under this serial number; unless given, the scene's."),
    ] = None
    actuator: Annotated[
        str | None, typer.Option(metavar="DRIVER", help="Play a sweep now, by this driver.")
    ] = None
    accelerometer: Annotated[
        str | None,
        typer.Option(metavar="DRIVER", help="On the handle, to record the sweep."),
    ] = None
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="ROLE.KEY=VALUE",
            help="An option of a driver, as actuator.port=/dev/ttyACM0; repeatable.",
        ),
    ] = None
    duration: Annotated[float, typer.Option(help="Seconds of the sweep, 2 to 60.")] = 8.0
    level_v: Annotated[
        float | None,
        typer.Option(help="Peak of the sweep (V); unless given, found by listening."),
    ] = None
    largest_m_s2: Annotated[
        float, typer.Option(help="Shake the handle by no more than about this (m/s2).")
    ] = 15.0
    keep: Annotated[
        Path | None, typer.Option(metavar="FILE.npz", help="Keep what was recorded.")
    ] = None
    low_hz: Annotated[
        float | None,
        typer.Option(help="Lower end of the band (Hz); unless given, found by the sweep."),
    ] = None
    high_hz: Annotated[float, typer.Option(help="Upper end of the band (Hz).")] = 450.0
    largest_gain_db: Annotated[
        float, typer.Option(help="Raise or lower a frequency by so much at most (dB).")
    ] = 12.0
    force: Force = False
    json_file: Annotated[Path | None, json_option("Write the figures.")] = None
