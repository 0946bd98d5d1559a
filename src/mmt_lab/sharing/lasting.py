"""Sessions whose listeners are behind a network, or make trouble for long."""

import asyncio
import json
import os
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from mmt.cli.child import Child
from mmt.core.arrays import FloatArray
from mmt.core.children import python_command
from mmt.core.errors import MmtError
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.findings import Findings
from mmt_lab.sharing.memory import Memory
from mmt_lab.sharing.troubled import EVERY_S, KINDS, STEADY

_SCENE: Final = "demo"
LAST_S: Final = 30.0
"""How long listeners may take to end after the session."""
_DISTANT: Final = 10
_LARGEST_GROWTH_MB: Final = 1.0


async def _session(
    duration_s: float,
    crowd: list[str],
    first: int,
    watch: Callable[[int], None] = lambda _: None,
) -> tuple[dict[str, Any], Any]:
    """Run one session with a crowd; return the leader's summary and what the crowd has found.

    Parameters
    ----------
    duration_s
        Of the session.
    crowd
        Module and arguments of the process that listens; it gets the address as the first one.
    first
        How many must listen before the follower is started.
    watch
        Called with the leader's process id at each line of its status.
    """
    environment = {**os.environ, "MMT_SHARING__PORT": "0"}
    common = [_SCENE, "--json-lines"]
    leader = await Child.start(
        "leader",
        "mmt.cli.child",
        ["leader", *common, "--share", "--port", "0", "--duration", str(duration_s)],
        environment,
    )
    children, summary, url = [leader], {}, ""
    where = ""
    listening: asyncio.subprocess.Process | None = None
    try:
        async for line in leader.lines():
            event = str(line.get("event", ""))
            watch(leader.pid)
            if line["kind"] == "ready":
                where = f"http://127.0.0.1:{line['port']}"
            if len(children) == 1 and where and f", {first} listening" in event:
                follower = ["follower", *common, "--leader", where]
                children.append(await Child.start("follower", "mmt.cli.child", follower))
            if line["kind"] == "summary":
                summary = line
            if event.startswith("shared at "):
                url = event.removeprefix("shared at ")
            if url and listening is None:
                module, *arguments = crowd
                listening = await start_listeners(module, url, *arguments)
        if listening is None or not summary:
            raise MmtError(f"no session was shared: {leader.messages}")
        return summary, await printed_by(listening)
    finally:
        if listening is not None and listening.returncode is None:
            listening.kill()
            await listening.wait()
        await asyncio.gather(*(child.kill() for child in children))


async def start_listeners(module: str, *arguments: str) -> asyncio.subprocess.Process:
    """Start a process of listeners in a session of its own, so that it may step back."""
    return await asyncio.create_subprocess_exec(
        *python_command("-m", module, *arguments),
        stdout=asyncio.subprocess.PIPE,
        start_new_session=os.name == "posix",
    )


async def printed_by(listeners: asyncio.subprocess.Process) -> Any:
    """Return what the listeners' process prints as it ends.

    Raises
    ------
    MmtError
        It prints nothing, or does not end.
    """
    try:
        printed, _ = await asyncio.wait_for(listeners.communicate(), LAST_S)
    except TimeoutError as error:
        raise MmtError(f"the listeners had not ended {LAST_S:g} s after the session") from error
    if not printed:
        raise MmtError("the listeners' process has ended without a word")
    return json.loads(printed)


def behind_network(network: str, duration_s: float) -> Findings:
    """Compare what listeners behind a network feel with what the operator feels."""
    command = ["mmt_lab.sharing.felt", str(_DISTANT), str(duration_s + LAST_S), network]
    leader, found = asyncio.run(_session(duration_s, command, _DISTANT + 1))
    errors, lags = np.array(found["errors_db"]), found["lags_ms"]
    if not len(errors) or not lags:
        raise MmtError("no listener behind the network had a model and a change of it")
    lag_50, lag_99 = np.percentile(lags, [50, 99])
    rows: dict[str, Figure] = {
        "listeners": ("listeners who had the model", found["listeners"], "at least", _DISTANT),
        "error_db": (
            "felt against the operator's, rms over bands, motion and time (dB)",
            _rms(errors),
            "at most",
            0.1,
        ),
        "delay_error_db": (
            "the same of one who has each change as soon as the delay allows (dB)",
            _rms(np.array(found["delay_errors_db"])),
        ),
        "error_99_db": ("the same of the worst hundredth of the time (dB)", _worst(errors)),
        "same_share": ("share of the time with the operator's very model", found["same_share"]),
        "behind": ("listeners without the last state", found["behind_at_end"], "at most", 0),
        "lag_p50_ms": ("from the leader's state to the listener's, p50 (ms)", lag_50),
        "lag_p99_ms": ("the same, p99 (ms)", lag_99),
        "repeated": ("packets lost and sent again", found["repeated"]),
        "wholes": ("whole models to each", found["wholes"] / _DISTANT),
        "frames_lost": ("frames that the leader lost", leader["link"]["lost"], "at most", 0),
    }
    about = (
        f"The demo's scene for {duration_s:g} s, {_DISTANT} listeners behind the network profile "
        f"{network}; from each one's first model to the end, every 50 ms."
    )
    return single_figures("Listeners behind a network", about, rows)


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def _worst(errors: FloatArray) -> float:
    return float(np.quantile(errors, 0.99))


def lasting(duration_s: float, seed: int) -> Findings:
    """Run a long session with listeners that make trouble, and one without any."""
    alone_s = min(60.0, duration_s)
    alone, _ = asyncio.run(
        _session(alone_s, ["mmt_lab.sharing.crowd", "1", str(alone_s + LAST_S)], 1)
    )
    memory = Memory()
    command = ["mmt_lab.sharing.troubled", str(duration_s + LAST_S), str(seed)]
    leader, found = asyncio.run(_session(duration_s, command, STEADY, memory.look))
    sharing = leader["sharing"]
    rows: dict[str, Figure] = {
        "tick_p99_ratio": (
            "leader's tick, p99, over that with one quiet listener",
            leader["ticks"]["period_p99_ms"] / alone["ticks"]["period_p99_ms"],
            "at most",
            1.1,
        ),
        "frames_lost": ("frames that the leader lost", leader["link"]["lost"], "at most", 0),
        "completed": ("the session completed", leader["outcome"] == "completed", "at least", 1),
        "steady": ("steady listeners with the last state", found["steady"], "at least", STEADY),
        "joined": ("listeners that joined", sharing["joined"]),
        **{kind: (text, found[kind]) for kind, text in KINDS.items()},
    }
    for who in ("leader", "sharing"):
        grown = memory.growth(who)
        rows[f"{who}_mb"] = (f"memory of the {who} process (MB)", grown.typical_mb)
        rows[f"{who}_growth_mb"] = (
            f"its growth, lower end of 95 % (MB in {grown.span_s:.0f} s)",
            grown.least_mb,
            "at most",
            _LARGEST_GROWTH_MB,
        )
        rows[f"{who}_slope_mb_h"] = (f"slope of the {who} process (MB/h)", grown.slope_mb_h)
    about = (
        f"The demo's scene for {duration_s / 60.0:g} min, {STEADY} listeners that stay, and others "
        f"that make trouble every {EVERY_S:g} s; memory after the first 30 %."
    )
    return single_figures("Sharing for long", about, rows)
