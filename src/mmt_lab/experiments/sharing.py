"""What it costs to share a model, and how soon listeners have it.

The demo's scene, leader and follower as processes, first with one listener and then with many. They
join within one second as soon as the model is ready, take each of its changes, and render nothing;
the time to the first model includes building it, one listener at a time. All runs on this machine.
"""

import asyncio
import json
import os
import sys
from typing import Annotated, Any, Final

import numpy as np
import typer

from mmt.cli.child import Child
from mmt.core.errors import MmtError
from mmt_lab.bench.measuring import Figure, single_figures
from mmt_lab.harness.experiment import Duration, Experiment
from mmt_lab.harness.findings import Findings

_SCENE: Final = "demo"
_LAST_S: Final = 30.0


async def _session(duration_s: float, count: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Run one session with a crowd; return the leader's summary and what the crowd has found."""
    environment = {**os.environ, "MMT_SHARING__PORT": "0"}
    common = [_SCENE, "--json-lines"]
    leader = await Child.start(
        "leader",
        "mmt.cli.entry",
        ["leader", *common, "--share", "--port", "0", "--duration", str(duration_s)],
        environment,
    )
    children, summary, url = [leader], {}, ""
    crowd: asyncio.subprocess.Process | None = None
    try:
        async for line in leader.lines():
            event = str(line.get("event", ""))
            if line["kind"] == "ready":
                where = f"http://127.0.0.1:{line['port']}"
                follower = ["follower", *common, "--leader", where]
                children.append(await Child.start("follower", "mmt.cli.entry", follower))
            elif event.startswith("shared at "):
                url = event.removeprefix("shared at ")
            elif event.startswith("start criterion"):
                crowd = await asyncio.create_subprocess_exec(
                    *(sys.executable, "-m", "mmt_lab.sharing.crowd", url),
                    *(str(count), str(duration_s + _LAST_S)),
                    stdout=asyncio.subprocess.PIPE,
                )
            elif line["kind"] == "summary":
                summary = line
        if crowd is None or not summary:
            raise MmtError(f"no session was shared: {leader.messages}")
        printed, _ = await asyncio.wait_for(crowd.communicate(), _LAST_S)
        return summary, json.loads(printed)
    finally:
        await asyncio.gather(*(child.kill() for child in children))


def run(
    duration: Duration = 18.0,
    listeners: Annotated[int, typer.Option(min=2, help="How many join at once.")] = 100,
) -> Findings:
    """Share the demo's model with one listener, and with many who join at once."""
    one, _ = asyncio.run(_session(duration, 1))
    leader, found = asyncio.run(_session(duration, listeners))
    sent, texture = leader["sharing"]["sent"], leader["texture"]
    firsts = [each["first_s"] for each in found if each["first_s"] is not None]
    lags = [lag for each in found for lag in each["lags_ms"]]
    if not firsts or not lags or not sent["changes"]:
        problems = {each["problem"] for each in found} - {""}
        raise MmtError(f"no listener had a model and a change of it: {' '.join(problems)}")
    behind = sum(each["number"] != leader["sharing"]["models"] for each in found)
    change_bytes = sent["changes_bytes"] / sent["changes"]
    a_second = leader["sharing"]["models"] / (texture["stop_s"] or duration)
    ratio = leader["ticks"]["period_p99_ms"] / one["ticks"]["period_p99_ms"]
    first_50, first_99 = np.percentile(firsts, [50, 99])
    lag_50, lag_99 = np.percentile(lags, [50, 99])
    rows: dict[str, Figure] = {
        "tick_p99_ratio": (
            "leader's tick, p99, over that with one listener",
            ratio,
            "at most",
            1.1,
        ),
        "joined": ("listeners who had the model", len(firsts), "at least", listeners),
        "behind": ("listeners without the last state", behind, "at most", 0),
        "rejected": ("messages that did not fit", sum(e["rejected"] for e in found), "at most", 0),
        "model_bytes": ("whole model, on joining (bytes)", sent["wholes_bytes"] / sent["wholes"]),
        "change_bytes_a_second": (
            "changes to each while modelling (bytes/s)",
            change_bytes * a_second,
            "at most",
            2000,
        ),
        "first_p50_s": ("from connecting to a built model, p50 (s)", first_50, "at most", 0.3),
        "first_p99_s": ("from connecting to a built model, p99 (s)", first_99, "at most", 1.0),
        "lag_p50_ms": (
            "from the leader's state to the listener's, p50 (ms)",
            lag_50,
            "at most",
            50,
        ),
        "lag_p99_ms": ("the same, p99 (ms)", lag_99, "at most", 200),
    }
    about = (
        f"The demo's scene for {duration:g} s, one listener and then {listeners}; after the model "
        "is complete nothing of it is sent."
    )
    return single_figures("Sharing", about, rows)


EXPERIMENT = Experiment(
    shows="what it costs to share a model, and how soon a hundred listeners have it",
    duration="1 min",
    run=run,
)
