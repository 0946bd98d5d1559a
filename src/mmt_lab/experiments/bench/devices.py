"""The device path: cost, latency and time errors of frames, by real drivers on emulated devices."""

import time
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Final

from mmt.core.errors import MmtError
from mmt.core.running.process import require_real_time
from mmt_lab.bench.device_path.emulated import (
    ACCELERATION_PPM,
    FORCE_PPM,
    Build,
    adxl335,
    bota,
    digital_ft,
    emulate,
    iio,
    net_ft,
    u6,
)
from mmt_lab.bench.device_path.frame_times import frame_times
from mmt_lab.bench.device_path.reader import read
from mmt_lab.harness.experiment import RealTime
from mmt_lab.harness.findings import Findings, FindingsTable, SkippedMethod, Target
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
    force: Build
    acceleration: Build
    arm: dict[str, Any] | None = None
    """Driver and options of an arm whose emulation runs within the reader; None for datagrams."""
    slow: bool = False
    """Whether a sensor's readings are too far apart to reach the targets for latency and jitter.
    These figures are then shown and not judged."""


Cells = dict[str, dict[str, float]]
"""Figures of a set-up, by the names of `TABLES` and of their columns."""


def measure_set_up(set_up: SetUp, *, realtime: bool) -> tuple[Cells, bool]:
    """Return the figures of a set-up, and whether its process imported numba or scipy."""
    calls = (emulate, set_up.force, set_up.acceleration, realtime), (read,)
    with background_processes(*calls) as (lab, reader):
        job = {
            **received(lab, START_S),
            **({"robot": set_up.arm} if set_up.arm else {}),
            "realtime": realtime,
            "bare_s": min(_BARE_S, DURATION_S),
        }
        reader.send(job)
        _await(reader, "ready", True, START_S)
        _ask(lab, "begin")
        time.sleep(min(_SETTLE_S, DURATION_S))
        reader.send("begin")
        time.sleep(DURATION_S)
        reader.send("end")
        _await(reader, "ended", True)
        seen_after_ms = [_stop(lab, reader, sensor) for _ in range(STOPS) for sensor in _PPM]
        reader.send("finish")
        found = _await(reader, "finished", True)
    if not len(found["frames"]):
        raise MmtError("no frame was formed: end what loads this machine, or use --realtime")
    return _cells(job, found, max(seen_after_ms)), bool(found["imported"])


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


def _cells(job: dict[str, Any], found: dict[str, Any], seen_ms: float) -> Cells:
    """Return the figures of a set-up whose stops were all seen after `seen_ms`."""
    frames = found["frames"]
    first, last = frames["sequence"][[0, -1]].tolist()
    values = {"force": frames["force_n"], "acceleration": frames["acceleration_m_s2"]}
    stated_ms = max(found["latency_ns"].values()) / 1e6
    times, offset_ms = frame_times(values, frames["time_ns"], found["formed_ns"], stated_ms)
    force_ppm, acceleration_ppm = (
        abs(
            found["devices"][sensor]["drift_ppm"]
            + (0.0 if job[sensor]["driver"] in _BY_THE_HOST else ppm)
        )
        for sensor, ppm in _PPM.items()
    )
    return {
        "cost": {
            "share of a core": found["core_share"],
            "emulation": found["emulated_share"],
            "tick alone": found["bare_share"],
        },
        "times": times,
        "frames": {
            "frames": len(frames),
            "missing": last - first + 1 - len(frames),
            "ticks 1 ms late (%)": 100.0 * (found["late_share_1ms"] or 0.0),
            "stop seen after, longest (ms)": seen_ms,
        },
        "clocks": {
            "error of the drift: force (ppm)": force_ppm,
            "acceleration (ppm)": acceleration_ppm,
            "offset of the time: force (ms)": offset_ms["force"],
            "acceleration (ms)": offset_ms["acceleration"],
        },
    }


SHOWS: Final = "what reading devices costs, and how late and how true frames are"
TAKES: Final = "6 min"
GROUP: Final = "bench"

OPENHAPTICS: Final = {"driver": "openhaptics", "options": {"library": "emulated"}}

SET_UPS: Final = (
    SetUp("virtual lab: Net F/T, ADXL335 on serial", net_ft, adxl335),
    SetUp("Digital F/T, ADXL335 on serial", digital_ft, adxl335),
    SetUp("Net F/T, ADXL335 at a U6", net_ft, u6),
    SetUp("OpenHaptics arm, Net F/T, ADXL335 on serial", net_ft, adxl335, OPENHAPTICS),
    SetUp("Net F/T, accelerometer of industrial I/O", net_ft, iio),
    SetUp("Bota on serial, accelerometer of industrial I/O", bota, iio, slow=True),
)

CORE_SHARE: Final = 0.25
LATENCY_MS: Final = 2.0
JITTER_MS: Final = 0.1
SEEN_MS: Final = 20.0

TABLES: Final = {
    "cost": "Cost",
    "times": "Latency and jitter",
    "frames": "Frames and stops",
    "clocks": "Clocks",
}
"""Titles of the tables by name."""

_REMEDY: Final = "see docs/reference/bench.md"


DURATION_S: Final = 20.0
STOPS: Final = 10
"""How often each sensor stops."""


def run(realtime: RealTime = False) -> Findings:
    """Measure cost, latency and time errors of frames, by real drivers on emulated devices.

    A set-up that cannot run here is left out.
    """
    if realtime:
        require_real_time()
    found: dict[str, Cells] = {}
    left_out = []
    importing = 0
    for set_up in SET_UPS:
        try:
            found[set_up.name], imported = measure_set_up(set_up, realtime=realtime)
        except MmtError as error:
            left_out.append(SkippedMethod(set_up.name, str(error), _REMEDY))
        else:
            importing += imported
    return Findings(
        title="Devices",
        about=(
            "The follower's real drivers on emulated devices in another process, arm, force and "
            f"acceleration at 1 kHz, {DURATION_S:g} s. The emulated values turn 20 times a "
            "second, so that each tells when it was measured, by the clock that both processes "
            "have; noise is switched off. Share: all processor time of the process that reads "
            "and forms frames; of it what stands for an arm, or for the library of a U6 or an "
            "arm; and that of its tick alone, which tells how busy the machine is. Latency: from "
            "the instant of a frame's oldest value to the frame, less what the slowest sensor "
            "states of itself. Jitter: how far the error of a frame's time is from its median; "
            "apart: the instants of its two values. "
            "Seen: from when a sensor stops to when the follower knows, the longest of "
            f"{2 * STOPS} times. A force sensor whose frames are a millisecond apart and come "
            "through a USB adapter cannot have the latency aimed at: its set-up is shown and not "
            "judged by it." + (" By real-time scheduling." if realtime else "")
        ),
        records=tuple(
            FindingsTable(
                key, title, tuple({"set-up": name, **one[key]} for name, one in found.items())
            )
            for key, title in TABLES.items()
        ),
        targets=_targets(found, {one.name for one in SET_UPS if one.slow}, importing),
        left_out=tuple(left_out),
    )


def _targets(found: Mapping[str, Cells], slow: Set[str], importing: int) -> tuple[Target, ...]:
    """Return the targets for the worst set-up; for latency and jitter without the slow ones."""
    quick = [one["times"] for name, one in found.items() if name not in slow]
    jitters = "jitter p99: force (ms)", "acceleration (ms)"
    jitters_ms = [times[jitter] for times in quick for jitter in jitters]
    seen_ms = [one["frames"]["stop seen after, longest (ms)"] for one in found.values()]
    costs = [one["cost"] for one in found.values()]
    shares = [cost["share of a core"] - cost["emulation"] for cost in costs]
    worst: tuple[tuple[str, Sequence[float], float], ...] = (
        ("share of a core, without emulation", shares, CORE_SHARE),
        ("latency sensor to frame, p99 (ms)", [times["p99 (ms)"] for times in quick], LATENCY_MS),
        ("jitter of a frame's time, p99 (ms)", jitters_ms, JITTER_MS),
        ("stopped sensor seen after, longest (ms)", seen_ms, SEEN_MS),
    )
    with_imports = float(importing) if found else None
    return (
        *(Target(what, max(of, default=None), "at most", bound) for what, of, bound in worst),
        Target("set-ups that import scipy or numba", with_imports, "at most", 0),
    )
