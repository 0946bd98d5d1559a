"""One set-up of devices: start it, measure it, stop its sensors one after the other."""

import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Final

from mmt.core.errors import MmtError
from mmt_lab.bench.device_path.emulated import ACCELERATION_PPM, FORCE_PPM, emulate
from mmt_lab.bench.device_path.frame_times import FrameTimes, frame_times
from mmt_lab.bench.device_path.reader import read
from mmt_lab.harness.processes import background_processes, received

START_S: Final = 60.0
"""How long a process may take until it is ready."""
ANSWER_S: Final = 20.0
"""How long a process may take to answer."""

_BARE_S: Final = 2.0
_SETTLE_S: Final = 2.0
_PAUSE_S: Final = 0.3
_BY_THE_HOST: Final = {"iio-accelerometer"}
"""Drivers that stamp readings by the host's own clock, so that their drift is zero."""
_PPM: Final = {"force_sensor": FORCE_PPM, "accelerometer": ACCELERATION_PPM}


@dataclass(frozen=True)
class SetUp:
    """Devices that are measured together."""

    name: str
    force: str
    acceleration: str
    arm: dict[str, Any] | None = None
    """Driver and options of an arm whose emulation runs within the reader; None for datagrams."""
    slow: bool = False
    """Whether a sensor's readings are too far apart to reach the targets for latency and jitter.
    These figures are then shown and not judged."""


@dataclass(frozen=True)
class SetUpFigures:
    """Figures of one set-up."""

    core_share: float
    """Share of a core that the process uses that reads devices and forms frames."""
    emulated_share: float
    """The part of this share that emulates devices inside that process."""
    bare_share: float
    """Share of a core of an empty tick in that process, measured beforehand."""
    frames: int
    missing: int
    """Frames that could not be formed."""
    times: FrameTimes
    drift_errors_ppm: dict[str, float]
    """Error of the estimated clock drift at the end, by sensor."""
    seen_after_ms: list[float]
    """Time from the stop of a sensor until its loss was reported, for each stop."""
    late_share_1ms: float
    """Share of the ticks that came over 1 ms late."""
    imported: list[str]
    """Those of numba and scipy that the process imported."""


def measure_set_up(
    set_up: SetUp, duration_s: float, stops: int, *, realtime: bool = False
) -> SetUpFigures:
    """Measure one set-up."""
    calls = (emulate, set_up.force, set_up.acceleration, realtime), (read,)
    with background_processes(*calls) as (lab, reader):
        job = {
            **received(lab, START_S),
            **({"robot": set_up.arm} if set_up.arm else {}),
            "realtime": realtime,
            "bare_s": min(_BARE_S, duration_s),
        }
        reader.send(job)
        _await(reader, "ready", True, START_S)
        _ask(lab, "begin")
        time.sleep(min(_SETTLE_S, duration_s))
        reader.send("begin")
        time.sleep(duration_s)
        reader.send("end")
        _await(reader, "ended", True)
        seen_after_ms = [
            _stop(lab, reader, sensor)
            for _ in range(stops)
            for sensor in ("force_sensor", "accelerometer")
        ]
        reader.send("finish")
        return _evaluate(job, _await(reader, "finished", True), seen_after_ms)


def _ask(lab: Connection, words: str) -> Any:
    lab.send(words)
    return received(lab, ANSWER_S)


def _await(
    reader: Connection, key: str, value: object, longest_s: float = ANSWER_S
) -> dict[str, Any]:
    """Return the next message that has this value for this key, and skip other messages."""
    while True:
        answer: dict[str, Any] = received(reader, longest_s)
        if answer.get(key) == value:
            return answer


def _stop(lab: Connection, reader: Connection, sensor: str) -> float:
    """Stop a sensor until its loss is reported; return the time that took, in ms."""
    stopped_ns = _ask(lab, f"stall {sensor}")
    role = f"the {sensor.replace('_', ' ')} "
    while True:  # a busy machine may report an earlier loss first
        event = _await(reader, "lost", True)
        if event["at_ns"] > stopped_ns and event["sentence"].startswith(role):
            break
    _ask(lab, f"resume {sensor}")
    _await(reader, "lost", False)
    time.sleep(_PAUSE_S)
    return float(event["at_ns"] - stopped_ns) / 1e6


def _evaluate(
    job: dict[str, Any], found: dict[str, Any], seen_after_ms: list[float]
) -> SetUpFigures:
    frames = found["frames"]
    if not len(frames):
        raise MmtError("no frame was formed: end what loads this machine, or use --realtime")
    values = {"force": frames["force_n"], "acceleration": frames["acceleration_m_s2"]}
    span = int(frames["sequence"][-1]) - int(frames["sequence"][0]) + 1
    return SetUpFigures(
        core_share=found["core_share"],
        emulated_share=found["emulated_share"],
        bare_share=found["bare_share"],
        frames=len(frames),
        missing=span - len(frames),
        times=frame_times(
            values,
            frames["time_ns"],
            found["formed_ns"],
            max(found["latency_ns"].values()) / 1e6,
        ),
        drift_errors_ppm={
            sensor: abs(
                found["devices"][sensor]["drift_ppm"]
                + (0.0 if job[sensor]["driver"] in _BY_THE_HOST else ppm)
            )
            for sensor, ppm in _PPM.items()
        },
        seen_after_ms=seen_after_ms,
        late_share_1ms=found["late_share_1ms"] or 0.0,
        imported=found["imported"],
    )
