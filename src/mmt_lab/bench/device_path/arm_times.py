"""How late positions and commands of one arm or handle are: measured, and judged."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from mmt.core.arrays import FloatArray, IntArray
from mmt.core.errors import MmtError
from mmt.core.extras import require
from mmt.devices.drivers import Role
from mmt.devices.source import PERIOD_NS as TICK_NS
from mmt_lab.bench.device_path.children import ANSWER_S, START_S, BenchChild, keep_for
from mmt_lab.bench.device_path.frame_times import (
    PERIOD_NS,
    pauses_of_ticks,
    time_errors_ms,
    within,
)

_SETTLE_S: Final = 1.0
_MS: Final = 1e6
_CHANGE: Final = 1e-3
"""mm, or N: less is the rounding of a command at rest."""


@dataclass(frozen=True)
class TimedArm:
    """One arm or handle."""

    title: str
    driver: str
    role: Role = "robot"
    package: str | None = None
    """An optional one that its driver needs."""


ARMS: Final = {
    "datagrams": TimedArm("virtual robot, datagrams", "mmt.testing.emulated.robot:DatagramRobot"),
    "ur": TimedArm("UR arm", "ur", package="rtde_control"),
    "inverse3": TimedArm("Inverse3 as robot", "inverse3"),
    "inverse3_handle": TimedArm("Inverse3 as handle", "inverse3", "handle"),
}
"""By the names of the lab."""


@dataclass(frozen=True)
class Delays:
    """How long something takes; all in ms."""

    p50_ms: float
    p99_ms: float
    jitter_p50_ms: float
    """How far one is from the median."""
    jitter_p99_ms: float

    @classmethod
    def of(cls, delays_ms: FloatArray) -> Self:
        """Return what single ones (n,), n >= 1, come to."""
        median = np.median(delays_ms)
        jitters = np.abs(delays_ms - median)
        return cls(
            float(median),
            float(np.percentile(delays_ms, 99)),
            float(np.median(jitters)),
            float(np.percentile(jitters, 99)),
        )


@dataclass(frozen=True)
class ArmTimes:
    """What one arm or handle gave."""

    positions: Delays
    """From the instant of a position to when it is read first."""
    running_p99_ms: float | None
    """Of the positions during which no tick was held up; None where all were."""
    new_positions: int
    commands: Delays
    """From a step of the command to when the device is told the first of it."""
    steps: int
    unanswered: int
    """Steps of which the device was told nothing before the next one."""


def position_delays_ms(places_mm: FloatArray, read_ns: IntArray) -> tuple[FloatArray, IntArray]:
    """Return how old positions are that were not there at the read before, and when they came.

    Parameters
    ----------
    places_mm
        Positions of a `Motion` about zero, (n, 3).
    read_ns
        When each was read, (n,).

    Returns
    -------
    delays_ms, came_ns
        Shape (m,); a delay is known but for whole turns of 50 ms.
    """
    new = np.any(np.diff(places_mm, axis=0) != 0.0, axis=1)
    came_ns = read_ns[1:][new]
    ahead_ms = time_errors_ms(places_mm[1:][new], came_ns)
    return np.mod(-ahead_ms, PERIOD_NS / _MS), came_ns


def command_delays_ms(stepped_ns: IntArray, heard_ns: IntArray, values: FloatArray) -> FloatArray:
    """Return after how long a device was told of each step, nan where of none of it, (n,).

    Parameters
    ----------
    stepped_ns
        When a step was commanded, after the command had come to rest, (n,).
    heard_ns, values
        When the device was told another command than before, (m,), and which, (m, 3).
    """
    delays = np.full(len(stepped_ns), np.nan)
    ends_ns = np.append(stepped_ns[1:], np.iinfo(np.int64).max)
    for step, (begin_ns, end_ns) in enumerate(zip(stepped_ns, ends_ns, strict=True)):
        first, last = np.searchsorted(heard_ns, (begin_ns, end_ns))
        if not first:  # nothing was told before, so nothing of it can differ
            continue
        away = np.abs(values[first:last] - values[first - 1]).max(axis=1, initial=0.0)
        changed = np.flatnonzero(away > _CHANGE)
        if len(changed):
            delays[step] = (heard_ns[first + changed[0]] - begin_ns) / _MS
    return delays


def measure_arm(arm: str, duration_s: float, *, realtime: bool = False) -> ArmTimes:
    """Measure one arm or handle.

    Parameters
    ----------
    arm
        A key of `ARMS`.
    duration_s
        How long it is read and commanded.
    realtime
        Whether both processes run by real-time scheduling.

    Raises
    ------
    InputError
        A package that its driver needs is not installed.
    MmtError
        A process ends, or nothing is read, or no command arrives.
    """
    wanted = ARMS[arm]
    if wanted.package is not None:
        require(wanted.package)
    scheduling = "realtime" if realtime else "ordinary"
    lab = BenchChild("mmt_lab.bench.device_path.arms", arm, scheduling)
    try:
        options = lab.receive(START_S)
        with tempfile.TemporaryDirectory() as folder:
            job = {
                "driver": wanted.driver,
                "options": options,
                "role": wanted.role,
                "realtime": realtime,
                "file": str(Path(folder) / "reads.npz"),
            }
            return _measure(job, lab, duration_s)
    finally:
        lab.close()


def _measure(job: dict[str, Any], lab: BenchChild, duration_s: float) -> ArmTimes:
    reader = BenchChild("mmt_lab.bench.device_path.arm_reader")
    try:
        keep_for(duration_s, job, lab=lab, reader=reader, settle_s=_SETTLE_S)
        reader.finish()
        reader.receive_where("written", True, ANSWER_S)
    finally:
        reader.close()
    heard = lab.ask("commands", ANSWER_S)
    with np.load(job["file"]) as reads:
        return judge(
            dict(reads),
            np.array(heard["times_ns"], dtype=np.int64),
            np.array(heard["values"], dtype=np.float64).reshape(-1, 3),
        )


def judge(reads: dict[str, Any], heard_ns: IntArray, values: FloatArray) -> ArmTimes:
    """Return what reads and commands come to.

    Raises
    ------
    MmtError
        Nothing was read, or no command has arrived.
    """
    if len(reads["places_mm"]) < 2:
        raise MmtError("nothing was read: end what loads this machine, or use --realtime")
    delays_ms, came_ns = position_delays_ms(reads["places_mm"], reads["read_ns"])
    told_ms = command_delays_ms(reads["stepped_ns"], heard_ns, values)
    answered = np.isfinite(told_ms)
    if not len(delays_ms) or not np.any(answered):
        missing = "no new position has come" if not len(delays_ms) else "no command has arrived"
        raise MmtError(f"{missing}: end what loads this machine, or use --realtime")
    pauses_ns = pauses_of_ticks(reads["ticked"], TICK_NS)
    instants_ns = came_ns - np.round(delays_ms * _MS).astype(np.int64)
    running_ms = delays_ms[~within(pauses_ns, instants_ns, came_ns)]
    return ArmTimes(
        positions=Delays.of(delays_ms),
        running_p99_ms=float(np.percentile(running_ms, 99)) if len(running_ms) else None,
        new_positions=len(delays_ms),
        commands=Delays.of(told_ms[answered]),
        steps=len(told_ms),
        unanswered=int(np.sum(~answered)),
    )
