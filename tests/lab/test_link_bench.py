import math

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.core.frames import COMMAND_DTYPE
from mmt_lab.bench.link_sides import Side, SideReport, TurnFigures
from mmt_lab.experiments.bench import link
from mmt_lab.experiments.bench.link import missing_at_end, order, ratios, summarise


def measured(**changes):
    values = {
        "p50_ms": 1.0,
        "p99_ms": 2.0,
        "rate_hz": 1000.0,
        "cores": 0.1,
        "lost": 0,
        "out_of_order": 0,
        **changes,
    }
    return TurnFigures("ours", **values)


def test_both_links_are_measured_and_lose_nothing(monkeypatch):
    monkeypatch.setattr(link, "RATE_HZ", 200)
    monkeypatch.setattr(link, "SUSTAINED_HZ", 800)
    result = link.bench_link(1.0)
    for kind in (result.ours, result.bare, result.sustained):
        for direction in kind.values():
            assert direction.rate_hz >= 100
            assert direction.lost == direction.out_of_order == 0
            assert 0 < direction.p50_ms <= direction.p99_ms
    assert result.sustained["up"].rate_hz > 1.5 * result.ours["up"].rate_hz > 0
    assert all(math.isfinite(ratio) and ratio > 0 for ratio in result.ratios.values())


def test_each_link_goes_first_every_other_time():
    assert [order(number)[0] for number in range(4)] == ["ours", "bare", "ours", "bare"]
    assert all(set(order(number)) == {"ours", "bare"} for number in range(2))


def test_a_disturbed_turn_does_not_move_the_ratios():
    ours = [(measured(p99_ms=3.0, cores=0.2), measured(p50_ms=1.25))] * 4
    bare = [(measured(), measured())] * 4
    disturbed = (measured(p50_ms=90.0, p99_ms=90.0, cores=0.9), measured(p99_ms=70.0))
    expected = {
        "up_p50": 1.0,
        "up_p99": 1.5,
        "down_p50": 1.25,
        "down_p99": 1.0,
        "leader_cores": 2.0,
        "follower_cores": 1.0,
    }
    assert ratios(ours, bare) == pytest.approx(expected)
    assert ratios([*ours, disturbed], [*bare, bare[0]]) == pytest.approx(expected)


def test_what_is_lost_is_summed_and_includes_the_tail():
    turns = [(measured(lost=2), measured()), (measured(out_of_order=1), measured())]
    result = summarise(turns, missing_up=3, missing_down=1)
    up, down = result["up"], result["down"]
    assert (up.lost, up.out_of_order) == (5, 1)
    assert (down.lost, down.out_of_order) == (1, 0)
    sender = SideReport([], {"ours": 10, "bare": 0}, {"ours": -1, "bare": -1})
    receiver = SideReport([], {"ours": 0, "bare": 0}, {"ours": 7, "bare": -1})
    assert missing_at_end(sender, receiver) == {"ours": 2, "bare": 0}


def test_a_side_counts_gaps_and_disorder():
    sender, receiver = Side(COMMAND_DTYPE), Side(COMMAND_DTYPE)
    records = [sender.next_record() for _ in range(8)]
    receiver.record_block(np.concatenate(records[:2]), 0)
    for number in (4, 3, 7):
        receiver.record(records[number].tobytes())
    assert (receiver.sent, receiver.lost, receiver.out_of_order) == (0, 2 + 2, 1)
    assert (sender.sent, sender.lost, sender.out_of_order) == (8, 0, 0)
    assert receiver.latency.count == 5


@pytest.mark.parametrize("duration_s", [0.0, -1.0, math.nan])
def test_the_duration_must_be_positive(duration_s):
    with pytest.raises(InputError, match="must be positive"):
        link.bench_link(duration_s)
