"""Measure mmt's link beside a bare WebSocket in one run: latency, processor time and losses.

Leader and follower are two processes on this machine. They keep mmt's link and a bare aiohttp
WebSocket open at the same time. The two links take turns of a second, with one record per message
both ways and payloads of the same size. The links alternate in going first, so that other load on
the machine affects both alike. In each round the leader's ticks lag behind the follower's by
another share of the period, the same for both links: so records arrive both while a process waits
and while it sends. The result is the median of the ratios between neighbouring turns: if another
program takes the processor for a moment, that spoils one turn, not the result. At the end mmt's
link runs for a while at a higher rate. With ``--loss`` the services run instead, over paths that
lose packets.
"""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Final, Literal

from mmt.core.errors import InputError
from mmt.core.frames import check_acceleration_rate
from mmt.core.running.process import require_real_time
from mmt_lab.bench.link_sides import PATIENCE_S, Kind, SideReport, Turn, TurnFigures, follow, lead
from mmt_lab.bench.lossy_path import measure_losses
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.experiment import AccelerationRate, Duration, Loss, RealTime
from mmt_lab.harness.findings import Findings
from mmt_lab.harness.processes import background_processes, received

SHOWS: Final = "what the link adds to a bare WebSocket in latency and processor time"
TAKES: Final = "1 min"
GROUP: Final = "bench"

ROUND_S: Final = 1.0
"""Longest turn."""
RATE_HZ: Final = 1000
"""Messages a second each way."""
SUSTAINED_HZ: Final = 5000
"""Messages a second each way of the last turn."""
_LEAD_TIME_NS: Final = 200_000_000
SUSTAINED_P99_MS: Final = 10.0
"""Bound on the latency at the sustained rate; above it messages pile up."""

_KINDS: Final[tuple[Kind, Kind]] = ("ours", "bare")


Ways = Mapping[Literal["up", "down"], TurnFigures]
"""One kind of link: frames up from follower to leader, and commands down to the follower."""


def bench_link(
    duration_s: float, *, samples_per_frame: int = 1, realtime: bool = False
) -> tuple[Ways, Ways, dict[str, float]]:
    """Measure mmt's link and a bare WebSocket in turns, then mmt's link at a higher rate.

    Parameters
    ----------
    duration_s
        How long each of the two links is measured, over all turns; the last turn lasts a quarter.
    samples_per_frame
        Samples of acceleration in each frame.
    realtime
        Whether both processes run by real-time scheduling, so that no other work of the machine
        comes in between.

    Returns
    -------
    ours, sustained, ratios
        mmt's link at both rates, and its figures over the bare WebSocket's by name: medians over
        the rounds.
    """
    if realtime:
        require_real_time()
    if not duration_s > 0:
        raise InputError(f"--duration {duration_s}: must be positive")
    rounds = max(1, round(duration_s / ROUND_S))
    turns = [
        Turn(kind, RATE_HZ, 0, duration_s / rounds, number / rounds)
        for number in range(rounds)
        for kind in (_KINDS if number % 2 == 0 else _KINDS[::-1])
    ]
    turns.append(Turn("ours", SUSTAINED_HZ, 0, duration_s / 4, 0.5))
    told = RATE_HZ, samples_per_frame, realtime
    with background_processes((lead, *told), (follow, *told)) as pipes:
        leader, follower = _conduct(pipes, turns)
    *compared, sustained = zip(leader.turns, follower.turns, strict=True)
    ours, bare = ([pair for pair in compared if pair[0].kind == kind] for kind in _KINDS)
    missing = missing_at_end(follower, leader), missing_at_end(leader, follower)
    return summarise(ours, 0, 0), summarise([sustained], *missing), ratios(ours, bare)


def _conduct(pipes: list[Connection], turns: list[Turn]) -> tuple[SideReport, SideReport]:
    """Exchange the ports, send both processes their turns, and receive their reports."""
    leader, follower = pipes
    follower.send(received(leader, PATIENCE_S))
    for pipe in pipes:
        received(pipe, PATIENCE_S)  # that it is ready
    plan: list[Turn] = []
    for turn in turns:
        start_ns = plan[-1].end_ns if plan else time.monotonic_ns() + _LEAD_TIME_NS
        plan.append(replace(turn, start_ns=start_ns))
    for pipe in pipes:
        pipe.send(plan)
    patience_s = (plan[-1].end_ns - time.monotonic_ns()) / 1e9 + PATIENCE_S
    return received(leader, patience_s), received(follower, patience_s)


def missing_at_end(sender: SideReport, receiver: SideReport) -> int:
    """Return how many of the last records never arrived over mmt's link."""
    return sender.sent - 1 - receiver.newest


Pair = tuple[TurnFigures, TurnFigures]
"""The leader's and the follower's figures of one turn."""


def summarise(turns: list[Pair], missing_up: int, missing_down: int) -> Ways:
    """Return the results of a link over its turns, by direction."""
    leader, follower = ([pair[end] for pair in turns] for end in (0, 1))
    return {"up": _direction(leader, missing_up), "down": _direction(follower, missing_down)}


def _direction(turns: list[TurnFigures], missing: int) -> TurnFigures:
    """Return the medians over the turns, and the sums of the counts; what is missing is lost."""
    medians = {
        name: statistics.median(getattr(turn, name) for turn in turns)
        for name in ("p50_ms", "p99_ms", "rate_hz", "cores")
    }
    return TurnFigures(
        turns[0].kind,
        **medians,
        lost=sum(turn.lost for turn in turns) + missing,
        out_of_order=sum(turn.out_of_order for turn in turns),
    )


def ratios(ours: list[Pair], bare: list[Pair]) -> dict[str, float]:
    """Return the medians of the ratios between neighbouring turns."""
    figures: dict[str, Callable[[TurnFigures, TurnFigures], float]] = {
        "up_p50": lambda leader, _: leader.p50_ms,
        "up_p99": lambda leader, _: leader.p99_ms,
        "down_p50": lambda _, follower: follower.p50_ms,
        "down_p99": lambda _, follower: follower.p99_ms,
        "leader_cores": lambda leader, _: leader.cores,
        "follower_cores": lambda _, follower: follower.cores,
    }
    return {
        name: statistics.median(
            figure(*one) / figure(*other) for one, other in zip(ours, bare, strict=True)
        )
        for name, figure in figures.items()
    }


def run(
    duration: Duration = 20.0,
    realtime: RealTime = False,
    loss: Loss = False,
    acceleration_rate: AccelerationRate = 1000,
) -> Findings:
    """Measure the link beside a bare WebSocket in one run, or over paths that lose packets."""
    check_acceleration_rate(acceleration_rate)
    if loss:
        if acceleration_rate != 1000:
            raise InputError("--acceleration-rate: not with --loss")
        return measure_losses(duration)
    samples = acceleration_rate // 1000
    ours, sustained, over_bare = bench_link(duration, samples_per_frame=samples, realtime=realtime)
    rows: dict[str, Figure] = {}
    for way, direction in ours.items():
        rows[f"{way}_lost"] = (f"{way}: lost or out of order", direction.wrong, "at most", 0)
        rows[f"{way}_p50_ms"] = (f"{way}: one way, p50 (ms)", direction.p50_ms)
        rows[f"{way}_p99_ms"] = (f"{way}: one way, p99 (ms)", direction.p99_ms)
    for name, ratio in over_bare.items():
        what = f"{name.replace('_', ' ')}: ours over bare WebSocket"
        rows[f"ratio_{name}"] = (what, ratio, "at most", 1.5)
    least_hz = 0.99 * SUSTAINED_HZ
    for way, direction in sustained.items():
        at, key = f"{way} at {SUSTAINED_HZ} Hz", f"sustained_{way}"
        p99 = f"{at}: one way, p99 (ms)"
        rows[f"{key}_hz"] = (f"{at}: messages a second", direction.rate_hz, "at least", least_hz)
        rows[f"{key}_lost"] = (f"{at}: lost or out of order", direction.wrong, "at most", 0)
        rows[f"{key}_p99_ms"] = (p99, direction.p99_ms, "at most", SUSTAINED_P99_MS)
    about = (
        f"One frame a message up, with acceleration at {samples} kHz, and one command a message "
        "down at 1 kHz, in turns of a second "
        f"with a bare WebSocket, {duration:g} s each; ratios are medians over neighbouring turns."
        + (" By real-time scheduling." if realtime else "")
    )
    return single_figures("Link", about, rows)
