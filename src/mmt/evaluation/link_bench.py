"""Measure the link beside a bare WebSocket: latency, processor time, losses, in one run.

Leader and follower are two processes on this machine. Each sends one message a tick, so
that frames go up and commands come down at the same rate. Rounds of the link and of a bare
aiohttp WebSocket, with payloads of the same size, alternate, so that both meet the same
machine. Run it with ``python -m mmt.evaluation.link_bench [SECONDS]``.
"""

import argparse
import multiprocessing
import statistics
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from typing import Any, Final

from mmt.errors import InputError, MmtError
from mmt.evaluation.link_sides import PATIENCE_S, Kind, Side, follow, lead

_KINDS: Final[tuple[Kind, ...]] = ("ours", "bare")


@dataclass(frozen=True)
class DirectionResult:
    """One direction of one kind of link: medians over the rounds, sums of what went wrong."""

    p50_ms: float
    p99_ms: float
    messages: int
    lost: int
    out_of_order: int


@dataclass(frozen=True)
class KindResult:
    """One kind of link; the processor time is in cores, median over the rounds."""

    up: DirectionResult
    """Frames, follower to leader."""
    down: DirectionResult
    """Commands, leader to follower."""
    leader_cores: float
    follower_cores: float


@dataclass(frozen=True)
class LinkBenchResult:
    """What `bench_link` measured; ``ratios`` are ours over bare."""

    duration_s: float
    rate_hz: int
    rounds: int
    ours: KindResult
    bare: KindResult

    @property
    def ratios(self) -> dict[str, float]:
        """Ours over bare, by what was measured."""
        ours, bare = self.ours, self.bare
        return {
            "up_p50": ours.up.p50_ms / bare.up.p50_ms,
            "up_p99": ours.up.p99_ms / bare.up.p99_ms,
            "down_p50": ours.down.p50_ms / bare.down.p50_ms,
            "down_p99": ours.down.p99_ms / bare.down.p99_ms,
            "leader_cores": ours.leader_cores / bare.leader_cores,
            "follower_cores": ours.follower_cores / bare.follower_cores,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return everything for a program."""
        return {**asdict(self), "ratios": self.ratios}


def bench_link(duration_s: float, rate_hz: int = 1000, *, rounds: int = 3) -> LinkBenchResult:
    """Measure the link and a bare WebSocket in alternating rounds.

    Parameters
    ----------
    duration_s
        How long each of the two is measured, over all rounds.
    rate_hz
        Messages a second each way.
    rounds
        How often the two take turns.

    Raises
    ------
    InputError
        A number is not positive.
    MmtError
        A process of the measurement failed.
    """
    if not (duration_s > 0 and rate_hz > 0 and rounds > 0):
        raise InputError(
            f"duration_s {duration_s}, rate_hz {rate_hz}, rounds {rounds}: all must be positive"
        )
    sides: dict[Kind, list[tuple[Side, Side]]] = {kind: [] for kind in _KINDS}
    for _ in range(rounds):
        for kind in _KINDS:
            sides[kind].append(_run_round(kind, duration_s / rounds, rate_hz))
    return LinkBenchResult(
        duration_s, rate_hz, rounds, _summarise(sides["ours"]), _summarise(sides["bare"])
    )


def _run_round(kind: Kind, duration_s: float, rate_hz: int) -> tuple[Side, Side]:
    """Measure one kind once; return the leader's and the follower's side."""
    context = multiprocessing.get_context("spawn")
    leader, leader_end = context.Pipe()
    follower, follower_end = context.Pipe()
    processes = [
        context.Process(target=lead, args=(kind, leader_end, rate_hz, duration_s)),
        context.Process(target=follow, args=(kind, follower_end, rate_hz, duration_s)),
    ]
    for process in processes:
        process.start()
    leader_end.close()
    follower_end.close()
    try:
        follower.send(_receive(leader, PATIENCE_S))
        return (
            _receive(leader, duration_s + 2 * PATIENCE_S),
            _receive(follower, duration_s + 2 * PATIENCE_S),
        )
    finally:
        for process in processes:
            process.join(1.0)
            process.terminate()
            process.join()
            process.close()
        leader.close()
        follower.close()


def _receive(pipe: Connection, timeout_s: float) -> Any:
    if not pipe.poll(timeout_s):
        raise MmtError(f"a process of the link's measurement gave nothing in {timeout_s:g} s")
    try:
        return pipe.recv()
    except EOFError as error:
        raise MmtError("a process of the link's measurement failed") from error


def _summarise(rounds: list[tuple[Side, Side]]) -> KindResult:
    return KindResult(
        up=_direction([(follower, leader) for leader, follower in rounds]),
        down=_direction(rounds),
        leader_cores=statistics.median(leader.cores for leader, _ in rounds),
        follower_cores=statistics.median(follower.cores for _, follower in rounds),
    )


def _direction(rounds: list[tuple[Side, Side]]) -> DirectionResult:
    """Summarise the way from the first of each pair to the second."""
    return DirectionResult(
        p50_ms=statistics.median(to.p50_ms for _, to in rounds),
        p99_ms=statistics.median(to.p99_ms for _, to in rounds),
        messages=sum(to.received for _, to in rounds),
        lost=sum(of.sent - to.received for of, to in rounds),
        out_of_order=sum(to.out_of_order for _, to in rounds),
    )


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seconds", nargs="?", type=float, default=60.0)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    result = bench_link(given.seconds, rounds=given.rounds)
    print(f"{'':6}{'up p50/p99 ms':>16}{'down p50/p99 ms':>18}{'cores':>14}  lost  out of order")
    for kind, of in (("ours", result.ours), ("bare", result.bare)):
        print(
            f"{kind:6}{of.up.p50_ms:>9.3f}/{of.up.p99_ms:.3f}{of.down.p50_ms:>12.3f}/"
            f"{of.down.p99_ms:.3f}{of.leader_cores:>9.2f}/{of.follower_cores:.2f}"
            f"{of.up.lost + of.down.lost:>6}{of.up.out_of_order + of.down.out_of_order:>14}"
        )
    print("ratio ", ", ".join(f"{name} {ratio:.2f}" for name, ratio in result.ratios.items()))


if __name__ == "__main__":
    main()
