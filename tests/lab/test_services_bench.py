"""Ticks beside strangers: what is compared, and that a stranger who is felt misses the target."""

from typing import Any

import pytest

from mmt.cli.scene_services import DemoRun
from mmt.core.errors import InputError
from mmt_lab.bench.strangers import BYSTANDER, KINDS
from mmt_lab.experiments import services


def test_a_stranger_who_makes_more_than_twice_the_ticks_late_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shares = {BYSTANDER: 0.01, "maps": 0.021}
    ran: list[str] = []

    async def beside(kind: str, _: float) -> DemoRun:
        ran.append(kind)
        return DemoRun(leader={"ticks": {"late_share_1ms": shares.get(kind, 0.02)}})

    monkeypatch.setattr(services, "_beside", beside)
    found: Any = services.run(duration=10.0, strangers=True)
    assert ran == ["alone", BYSTANDER, *KINDS] * 2
    assert found.figures["maps"] == pytest.approx(0.021)
    missed = [target.what for target in found.targets if not target.met]
    assert missed == [KINDS["maps"]]


def test_two_ways_at_once_are_refused() -> None:
    with pytest.raises(InputError, match="not both"):
        services.run(realtime=True, strangers=True)
