"""Faults of the services themselves: one that is stopped, a disk that is full, a tick held up."""

import asyncio
import math
import signal
import tempfile
import time
from collections.abc import Awaitable, Callable
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from mmt.core.arrays import RecordArray, Vector
from mmt.devices.protocols import InterfaceState
from mmt.follower.service import Follower
from mmt.leader.motion.force_ramp import RAMP_TICKS
from mmt.leader.service import Leader
from mmt.scene import Hand, Link
from mmt.scene.files import scene_from_tables
from mmt.session.mcap_reader import scanned_frames
from mmt.session.mcap_scan import scan_mcap
from mmt_lab.soak.services import SoakServices
from mmt_lab.stability.cases import CaseResult, Extreme

_DISK_BYTES: Final = 100_000
_BEFORE_S: Final = 1.5
_AFTER_S: Final = 4.0
_SPEED_MS: Final = 50
"""Speeds are means over this: the position sensor's noise is then under 1 mm/s."""
_HELD_UP_MS: Final = (80, 300, 1000)


def interrupted_cases(stopped_s: float) -> list[Extreme]:
    """Return the cases, those that this system has; `stopped_s` is how long a service is stopped.

    All but the last run the demo's services as processes.
    """
    fastest_mm_s = Hand().fastest_mm_s + Link().recovery_mm_s
    stopping = Extreme(
        f"the leader stopped for {stopped_s:g} s in a session",
        "it goes on, and every frame of that time is filled in",
        partial(_in_session, partial(_stop_leader, stopped_s), judge_stop),
    )
    stalling = Extreme(
        "the follower stopped for 1 s while the hand strokes",
        f"the robot catches up at {fastest_mm_s:g} mm/s at most",
        partial(_in_session, _stop_follower, partial(judge_speed, fastest_mm_s)),
    )
    full = Extreme(
        "a disk that is full in a session",
        "it goes on without the recording, what was written is readable",
        partial(_in_session, _fill_disk, judge_disk),
    )
    held_up = Extreme(
        f"ticks of the leader held up for {', '.join(map(str, _HELD_UP_MS))} ms, the tool pressed",
        f"no write changes the force by more than {100 / RAMP_TICKS:g} % of it",
        lambda: asyncio.run(_hold_up_ticks()),
    )
    stops = [stopping, stalling] if hasattr(signal, "SIGSTOP") else []
    return [*stops, *([full] if _can_limit_files() else []), held_up]


def _can_limit_files() -> bool:
    if find_spec("resource") is None:
        return False
    import resource

    return hasattr(resource, "prlimit")


Meddling = Callable[[SoakServices], Awaitable[None]]
Judging = Callable[[dict[str, Any], RecordArray], CaseResult]


def _in_session(meddle: Meddling, judge: Judging) -> CaseResult:
    """Run the demo's services, meddle with them, and judge the leader's summary and recording."""
    with tempfile.TemporaryDirectory(prefix="mmt-stability-") as directory:
        file = Path(directory) / "session.mcap"
        services = asyncio.run(_session(file, meddle))
        if not services.summary:
            return CaseResult("; ".join(services.errors), held=False)
        return judge(services.summary, scanned_frames(scan_mcap(file)))


async def _session(file: Path, meddle: Meddling) -> SoakServices:
    async with SoakServices(file, 0, lambda _: None) as services:
        await asyncio.sleep(_BEFORE_S)
        await meddle(services)
        await asyncio.sleep(_AFTER_S)
        await services.finish()
    return services


async def _stop_leader(stopped_s: float, services: SoakServices) -> None:
    await services.pause(leader=True, length_s=stopped_s)


async def _stop_follower(services: SoakServices) -> None:
    await services.pause(leader=False, length_s=1.0)


async def _fill_disk(services: SoakServices) -> None:
    import resource

    limit = (_DISK_BYTES, _DISK_BYTES)
    resource.prlimit(services.leader_pid, resource.RLIMIT_FSIZE, limit)


def judge_stop(summary: dict[str, Any], frames: RecordArray) -> CaseResult:
    """Judge a session in which the leader was stopped, by its summary and its frames (n,)."""
    gaps = summary.get("backfill", {"filled": 0, "lost": 0})  # none where nothing was missing
    steps = np.diff(frames["sequence"].astype(np.int64))
    absent = int((steps - 1).sum())
    return CaseResult(
        f"{summary['outcome']}; {gaps['filled']} frames filled in, {absent} not in the recording",
        held=summary["outcome"] == "stopped" and gaps["lost"] == absent == 0,
        figures={"filled": gaps["filled"], "lost": gaps["lost"], "absent": absent},
    )


def judge_speed(fastest_mm_s: float, summary: dict[str, Any], frames: RecordArray) -> CaseResult:
    """Judge how fast the robot was at most, over stretches without a missing frame."""
    place, number = frames["position_mm"].astype(np.float64), frames["sequence"].astype(np.int64)
    whole = number[_SPEED_MS:] - number[:-_SPEED_MS] == _SPEED_MS
    way_mm = np.linalg.norm(place[_SPEED_MS:] - place[:-_SPEED_MS], axis=1)[whole]
    speed_mm_s = float(1000.0 * way_mm.max() / _SPEED_MS)
    return CaseResult(
        f"{summary['outcome']}; {speed_mm_s:.0f} mm/s",
        held=summary["outcome"] == "stopped" and speed_mm_s <= 1.05 * fastest_mm_s,
        figures={"mm_s": speed_mm_s},
    )


def judge_disk(summary: dict[str, Any], frames: RecordArray) -> CaseResult:
    """Judge a session whose recording failed, by the frames (n,) that can be read."""
    written, error = summary["recording"]["frames"], summary["recording"]["error"]
    went_on = summary["link"]["frames"] - written
    return CaseResult(
        f"{summary['outcome']}; {error}; {len(frames)} frames readable, {went_on} more played",
        held=summary["outcome"] == "stopped"
        and error is not None
        and len(frames) >= written > 0
        and went_on > 1000.0 * _AFTER_S / 2,
        figures={"readable": len(frames), "went_on": went_on},
    )


class PressingHandle:
    """Goes down onto the surface, stays there, and notes the forces it is to display."""

    def __init__(self) -> None:
        self.forces_n: list[Vector] = []
        self._height_mm = 5.0

    def connect(self) -> None:
        """Do nothing."""

    def calibrate(self) -> None:
        """Do nothing."""

    def read(self, elapsed_ticks: int) -> InterfaceState:
        """Return the state: 10 mm/s down to 1.5 mm below the surface."""
        self._height_mm = max(-1.5, self._height_mm - 0.01 * elapsed_ticks)
        return InterfaceState((0.0, 0.0, self._height_mm), (0.0, 0.0, 0.0), 0.0, contact=False)

    def write(self, force_n: Vector) -> None:
        """Note a force."""
        self.forces_n.append(force_n)

    def close(self) -> None:
        """Do nothing."""


async def _hold_up_ticks() -> CaseResult:
    """Run both services here, press, and hold the event loop up."""
    tables: dict[str, Any] = {
        "link": {"port": 0, "recovery_mm_s": 100.0},
        "simulated": {"noise": False},
        "handle": f"{__name__}:PressingHandle",
        "force_feedback": {},
    }
    leader = Leader(scene_from_tables(tables))
    hand = leader.parts.hand
    assert hand is not None and hand.handle is not None  # noqa: S101, PT018
    handle = hand.handle.device
    assert isinstance(handle, PressingHandle)  # noqa: S101 - as the scene has it
    ready = asyncio.Event()
    leading = asyncio.create_task(leader.run(ready.set))
    await ready.wait()
    follower = Follower(leader.scene, f"http://127.0.0.1:{leader.port}")
    following = asyncio.create_task(follower.run())
    await asyncio.sleep(_BEFORE_S)
    pressed = len(handle.forces_n)
    for held_up_ms in _HELD_UP_MS:
        time.sleep(0.001 * held_up_ms)
        await asyncio.sleep(0.5)
    leader.stop()
    await asyncio.gather(leading, following)
    forces = handle.forces_n[pressed:]
    force_n = max(math.hypot(*force) for force in forces)
    step_n = max(math.dist(*pair) for pair in pairwise(forces))
    return CaseResult(
        f"{100 * step_n / force_n:.1f} % of {force_n:.2f} N",
        held=force_n > 1.0 and step_n <= force_n / RAMP_TICKS + 1e-3,
        figures={"step_n": step_n, "force_n": force_n},
    )
