"""The services over a path that loses packets: a real path below TCP, and emulated ones.

The real path is a relay of IP packets between two network namespaces with one service each. It
needs Linux and root.
"""

import asyncio
from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack
from typing import Any, Final

from mmt.core.errors import MmtError
from mmt_lab.bench.network_namespaces import LEADER_ADDRESS, relay
from mmt_lab.harness.findings import Cell, Findings, FindingsTable, SkippedMethod
from mmt_lab.sharing.session import ListenedSession

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
    followed = "follower", "stream-only", "--leader"
    try:
        async with AsyncExitStack() as stack, asyncio.timeout(duration_s + _STARTING_S):
            session = ListenedSession(stack)
            leader = await session.start(*led, prefix=within[0], environment=settings)
            url = f"http://{address}:{(await leader.line('ready'))['port']}"
            follower = await session.start(*followed, url, prefix=within[1], environment=settings)
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
