"""The bench's network namespaces for tests, which are skipped where the machine has none."""

from contextlib import ExitStack, contextmanager
from typing import ParamSpec

import pytest

from mmt.core.errors import MmtError
from mmt_lab.bench import lossy_path as bench
from mmt_lab.bench.lossy_path import (
    FOLLOWER_ADDRESS,
    LEADER_ADDRESS,
    Namespaces,
    bring_up,
    namespaces,
    run,
)

__all__ = ["LEADER_ADDRESS", "Namespaces", "netem", "relay", "veth", "within_follower"]

P = ParamSpec("P")


def _or_skipped(network):
    @contextmanager
    def entered(*arguments, **keys):
        with ExitStack() as stack:
            try:
                made = stack.enter_context(network(*arguments, **keys))
            except MmtError as error:
                pytest.skip(str(error))
            yield made

    return entered


@contextmanager
def _veth():
    """Make two namespaces that are joined without delay."""
    with namespaces() as made:
        ends = ("peer", "name", "mmt1", "netns", made.follower)
        run("ip", "-n", made.leader, "link", "add", "mmt0", "type", "veth", *ends)
        bring_up(made.leader, "mmt0", LEADER_ADDRESS)
        bring_up(made.follower, "mmt1", FOLLOWER_ADDRESS)
        yield made


@contextmanager
def _netem(delay_ms, jitter_ms):
    """Delay each packet by ``tc netem``, both ways."""
    with _veth() as made:
        delay = ("delay", f"{delay_ms}ms", f"{jitter_ms}ms", "limit", "100000")
        for name, device in ((made.leader, "mmt0"), (made.follower, "mmt1")):
            run("tc", "-n", name, "qdisc", "add", "dev", device, "root", "netem", *delay)
        yield made


def within_follower(made, clock_ahead_s):
    """Return the command that runs something on the follower's machine, whose clock is ahead."""
    elsewhen = ["unshare", "--time", "--monotonic", str(clock_ahead_s), "--fork"]
    return ["ip", "netns", "exec", made.follower, *elsewhen, "--kill-child"]


netem, relay, veth = map(_or_skipped, (_netem, bench.relay, _veth))
