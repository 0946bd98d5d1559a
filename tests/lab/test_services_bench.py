"""Ticks beside strangers: what is compared, and that a stranger who is felt misses the target."""

import pytest

from mmt.cli.running.scene_services import DemoRun
from mmt.core.errors import InputError
from mmt_lab.bench.strangers import BYSTANDER, KINDS
from mmt_lab.experiments.bench import services


def test_a_stranger_who_makes_more_than_twice_the_ticks_late_is_seen(monkeypatch):
    shares = {BYSTANDER: 0.01, "maps": 0.021}
    ran = []

    async def beside(kind, _):
        ran.append(kind)
        return DemoRun(leader={"ticks": {"late_share_1ms": shares.get(kind, 0.02)}})

    monkeypatch.setattr(services, "_beside", beside)
    found = services.run(duration=10.0, strangers=True)
    assert ran == ["alone", BYSTANDER, *KINDS] * 2
    assert found.figures["maps"] == pytest.approx(0.021)
    missed = [target.what for target in found.targets if not target.met]
    assert missed == [KINDS["maps"]]


def test_two_ways_at_once_are_refused():
    with pytest.raises(InputError, match="not both"):
        services.run(realtime=True, strangers=True)
