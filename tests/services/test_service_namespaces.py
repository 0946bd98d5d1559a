"""The two services on two networks and two clocks: the link against what the kernel does."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from network_namespaces import LEADER_ADDRESS, netem, relay, veth, within_follower
from service_processes import Service, scene

DELAY_MS, JITTER_MS = 40.0, 10.0
AHEAD_S = 5000
"""The follower's clock shows so much more than the leader's, exactly."""


@dataclass(frozen=True)
class Ended:
    """The summaries' tables of the link, and how late the services' ticks were."""

    leader: dict[str, Any]
    follower: dict[str, Any]
    late_ms: float

    def offset_errors_ms(self):
        """By how much either side errs in the other's clock."""
        return (
            self.leader["clock"]["offset_ms"] - 1000.0 * AHEAD_S,
            self.follower["clock"]["offset_ms"] + 1000.0 * AHEAD_S,
        )


@contextmanager
def leading(made, folder, duration_s, **variables):
    with Service(
        *("leader", scene("stream-only"), "--json-lines", "--port", 0, "--duration", duration_s),
        cwd=folder,
        within=made.within_leader(),
        **variables,
    ) as leader:
        yield leader


def stream(made, folder, duration_s=3, **variables):
    """Run a session between the two namespaces."""
    variables = {"MMT_LINK__HOST": LEADER_ADDRESS, "MMT_LINK__OPEN": "true", **variables}
    with leading(made, folder, duration_s, **variables) as leader:
        url = f"http://{LEADER_ADDRESS}:{leader.port()}"
        with Service(
            *("follower", scene("stream-only"), "--json-lines", "--leader", url),
            cwd=folder,
            within=within_follower(made, AHEAD_S),
            **variables,
        ) as follower:
            assert (leader.end(), follower.end()) == (0, 0), leader.stderr + follower.stderr
            summaries = leader.summary(), follower.summary()
            late_ms = max(summary["ticks"]["period_p99_ms"] - 1.0 for summary in summaries)
            return Ended(summaries[0]["link"], summaries[1]["link"], late_ms)


@pytest.mark.parametrize("delayed", [netem, relay])
def test_the_emulation_delays_as_a_network_below_tcp_does(tmp_path, delayed):
    """Medians alone: TCP's slow start and what it sends again lengthen the upper end."""
    emulation = {"MMT_NETWORK__DELAY_MS": "40", "MMT_NETWORK__JITTER_MS": "10"}
    with delayed(DELAY_MS, JITTER_MS) as real, veth() as plain, ThreadPoolExecutor() as pool:
        runs = (
            pool.submit(stream, real, tmp_path),
            pool.submit(stream, plain, tmp_path, **emulation),
        )
        ended, emulated = (run.result(150.0) for run in runs)
        relay_ms = 1000.0 * float(np.quantile(real.late_s, 0.9)) if real.late_s else 0.0
    busy_ms = 2.0 * relay_ms + ended.late_ms + emulated.late_ms  # what this machine adds
    for side in ("leader", "follower"):
        packets, messages = getattr(ended, side), getattr(emulated, side)
        # each message waits for the slowest before it, in either: the median is not the mean delay
        assert packets["latency_p50_ms"] > DELAY_MS
        assert messages["latency_p50_ms"] > DELAY_MS
        assert messages["latency_p50_ms"] == pytest.approx(
            packets["latency_p50_ms"], abs=JITTER_MS + busy_ms
        )
        assert packets["lost"] == messages["lost"] == 0
        assert packets["emulated"] == {}
    for session in (ended, emulated):
        assert max(map(abs, session.offset_errors_ms())) < JITTER_MS / 2 + busy_ms
