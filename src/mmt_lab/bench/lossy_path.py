"""The services over a path that loses packets: between network namespaces, and emulated ones.

The real path is a relay of IP packets between two network namespaces with one service each. It
replaces ``tc netem``, which not every kernel has: it delays or drops each IP packet
between two tun devices, below TCP, and is independent of mmt. This needs Linux and root; the
functions raise `MmtError` if the machine cannot do it.
"""

import asyncio
import heapq
import itertools
import os
import random
import select
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, Final

from mmt.core.errors import MmtError
from mmt_lab.harness.findings import Cell, Findings, FindingsTable, SkippedMethod
from mmt_lab.sharing.session import start_service

LEADER_ADDRESS = "10.77.83.1"
FOLLOWER_ADDRESS = "10.77.83.2"

_TUNSETIFF = 0x400454CA
_TUN_WITHOUT_HEADER = 0x1001
_numbers = itertools.count()


@dataclass(frozen=True)
class Namespaces:
    """Names of the two namespaces."""

    leader: str
    follower: str
    late_s: list[float] = field(default_factory=list, compare=False)
    """Bound on how much too long the relay held each packet, in s; empty without a relay."""

    def within_leader(self) -> list[str]:
        """Return the start of a command that runs in the leader's namespace."""
        return ["ip", "netns", "exec", self.leader]


def run(*command: str) -> None:
    """Run a system command; raise `MmtError` if it is missing or fails."""
    try:
        done = subprocess.run(  # noqa: S603
            command, check=False, capture_output=True, text=True, timeout=20
        )
    except FileNotFoundError as error:
        raise MmtError(f"this machine has no {command[0]}") from error
    if done.returncode:
        raise MmtError(f"{' '.join(command)}: {done.stderr.strip()}")


@contextmanager
def namespaces() -> Iterator[Namespaces]:
    """Make two namespaces that are not connected."""
    if sys.platform != "linux" or os.geteuid() != 0:
        raise MmtError("network namespaces need Linux and root")
    run("unshare", "--time", "--monotonic", "1", "--fork", "true")
    number = f"{os.getpid()}-{next(_numbers)}"
    made = Namespaces(f"mmt-leader-{number}", f"mmt-follower-{number}")
    try:
        for name in (made.leader, made.follower):
            run("ip", "netns", "add", name)
            run("ip", "-n", name, "link", "set", "lo", "up")
        yield made
    finally:
        for name in (made.leader, made.follower):
            subprocess.run(  # noqa: S603
                ["ip", "netns", "delete", name],  # noqa: S607
                check=False,
                capture_output=True,
                timeout=150,
            )


@contextmanager
def relay(delay_ms: float, jitter_ms: float, loss: float = 0.0) -> Iterator[Namespaces]:
    """Join two namespaces by a relay that delays or drops each packet, both ways."""
    first, second = f"mmt{os.getpid()}a", f"mmt{os.getpid()}b"
    with namespaces() as made, _tun(first) as one, _tun(second) as other:
        run("ip", "link", "set", first, "netns", made.leader)
        run("ip", "link", "set", second, "netns", made.follower)
        bring_up(made.leader, first, LEADER_ADDRESS)
        bring_up(made.follower, second, FOLLOWER_ADDRESS)
        ended = threading.Event()
        passing = threading.Thread(
            target=_pass, args=(one, other, delay_ms, jitter_ms, loss, ended, made.late_s)
        )
        passing.start()
        try:
            yield made
        finally:
            ended.set()
            passing.join(60.0)


def bring_up(namespace: str, device: str, address: str) -> None:
    """Give a device in a namespace its address, and bring the device up."""
    run("ip", "-n", namespace, "address", "add", f"{address}/30", "dev", device)
    run("ip", "-n", namespace, "link", "set", device, "up")


@contextmanager
def _tun(name: str) -> Iterator[int]:
    import fcntl  # not on Windows

    try:
        file = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    except OSError as error:
        raise MmtError(f"/dev/net/tun: {error.strerror}") from error
    try:
        try:
            request = struct.pack("16sH22x", name.encode(), _TUN_WITHOUT_HEADER)
            fcntl.ioctl(file, _TUNSETIFF, request)
        except OSError as error:
            raise MmtError(f"no tun device: {error.strerror}") from error
        yield file
    finally:
        os.close(file)


def _pass(
    one: int,
    other: int,
    delay_ms: float,
    jitter_ms: float,
    loss: float,
    ended: threading.Event,
    late_s: list[float],
) -> None:
    """Drop each packet, or hold it for its own random time, as netem does, and pass it on."""
    generator = random.Random(1)  # noqa: S311 - an emulation, no secret
    held: list[tuple[float, int, int, bytes, float]] = []
    numbers = itertools.count()
    towards = {one: other, other: one}
    looked_s = time.monotonic()
    while not ended.is_set():
        wait_s = held[0][0] - time.monotonic() if held else 0.05
        readable, _, _ = select.select([one, other], [], [], min(max(wait_s, 0.0), 0.05))
        unseen_s, looked_s = time.monotonic() - looked_s, time.monotonic()
        for file in readable:
            with suppress(BlockingIOError):
                for _ in range(64):  # packets that came while this thread did not run
                    packet = os.read(file, 65_536)
                    if generator.random() < loss:
                        continue
                    delay_s = (delay_ms + generator.uniform(-jitter_ms, jitter_ms)) / 1000
                    due_s = time.monotonic() + delay_s
                    heapq.heappush(held, (due_s, next(numbers), towards[file], packet, unseen_s))
        while held and held[0][0] <= time.monotonic():
            due_s, _, file, packet, unseen_s = heapq.heappop(held)
            os.write(file, packet)
            late_s.append(time.monotonic() - due_s + unseen_s)


LOSSES: Final = (0.0, 0.001, 0.01, 0.03)
"""Share of packets or messages that is lost each way."""
DELAY_MS: Final = 40.0
"""One way; without jitter."""
_STARTING_S: Final = 60.0


def measure_losses(duration_s: float) -> Findings:
    """Run the services over each path with each loss."""
    left_out: list[SkippedMethod] = []
    records = []
    rows = []
    for loss in LOSSES:
        with ExitStack() as stack:
            try:
                path = stack.enter_context(relay(DELAY_MS, 0.0, loss))
            except MmtError as error:
                left_out.append(SkippedMethod("TCP", str(error), "run it on Linux, as root"))
                break
            within = path.within_leader(), ["ip", "netns", "exec", path.follower]
            rows.append(_row(loss, asyncio.run(_session(duration_s, LEADER_ADDRESS, within))))
    if rows:
        records.append(FindingsTable("tcp", "TCP between network namespaces", tuple(rows)))
    for name, title, retransmit in (
        ("retransmitted", "Emulated, what is lost is sent again", "true"),
        ("datagrams", "Emulated, what is lost stays lost", "false"),
    ):
        rows = []
        for loss in LOSSES:
            variables = {
                "MMT_NETWORK__DELAY_MS": str(DELAY_MS),
                "MMT_NETWORK__LOSS": str(loss),
                "MMT_NETWORK__RETRANSMIT": retransmit,
            }
            ran = asyncio.run(_session(duration_s, "127.0.0.1", ([], []), variables))
            rows.append(_row(loss, ran))
        records.append(FindingsTable(name, title, tuple(rows)))
    about = (
        f"Streamed vibration and motion at 1 kHz, {DELAY_MS:g} ms each way, {duration_s:g} s a "
        "row, with the share of packets, or of emulated messages, that is lost each way. TCP: a "
        "relay between two network namespaces delays and loses IP packets."
    )
    title = "The link over a path that loses packets"
    return Findings(title, about, records=tuple(records), left_out=tuple(left_out))


async def _session(
    duration_s: float,
    address: str,
    within: tuple[Sequence[str], Sequence[str]],
    variables: Mapping[str, str] | None = None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Run one session; return the leader's and the follower's summary."""
    settings = {"MMT_LINK__HOST": address, "MMT_LINK__OPEN": "true", **(variables or {})}
    led = "leader", "stream-only", "--port", "0", "--duration", str(duration_s)
    try:
        async with AsyncExitStack() as stack, asyncio.timeout(duration_s + _STARTING_S):
            leader = await start_service(stack, *led, prefix=within[0], environment=settings)
            url = f"http://{address}:{(await leader.line('ready'))['port']}"
            followed = "follower", "stream-only", "--leader", url
            follower = await start_service(stack, *followed, prefix=within[1], environment=settings)
            return await leader.line("summary"), await follower.line("summary")
    except TimeoutError as error:
        raise MmtError(f"a session over {address} did not end in time") from error


def _row(loss: float, summaries: tuple[dict[str, Any], dict[str, Any]]) -> Mapping[str, Cell]:
    """Return a row of the table."""
    leader, follower = summaries
    row: dict[str, Cell] = {"loss (%)": 100 * loss}
    for what, link in (("frames", leader["link"]), ("commands", follower["link"])):
        for quantile in ("p50", "p99", "max"):
            row[f"{what} {quantile} (ms)"] = link[f"latency_{quantile}_ms"]
    commands = follower["commands"]
    row["held, times"] = commands["silences"]
    row["held (s)"] = commands["silent_s"]
    row["ticks slowed (%)"] = 100 * commands["slowed_ticks"] / follower["ticks"]["ticks"]
    row["vibration's age (ms)"] = leader["vibration"]["playout"]["age_ms"]
    return row
