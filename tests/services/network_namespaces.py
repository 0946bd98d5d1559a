"""The bench's network namespaces for tests, which are skipped where the machine has none."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import ParamSpec

import pytest

from mmt.core.errors import MmtError
from mmt_lab.bench import network_namespaces as bench
from mmt_lab.bench.network_namespaces import LEADER_ADDRESS, Namespaces

__all__ = ["LEADER_ADDRESS", "Namespaces", "netem", "relay", "veth"]

P = ParamSpec("P")


def _or_skipped(
    network: Callable[P, AbstractContextManager[Namespaces]],
) -> Callable[P, AbstractContextManager[Namespaces]]:
    @contextmanager
    def entered(*arguments: P.args, **keys: P.kwargs) -> Iterator[Namespaces]:
        with ExitStack() as stack:
            try:
                made = stack.enter_context(network(*arguments, **keys))
            except MmtError as error:
                pytest.skip(str(error))
            yield made

    return entered


netem, relay, veth = map(_or_skipped, (bench.netem, bench.relay, bench.veth))
