import json
import math
import multiprocessing

import pytest

from mmt.errors import InputError, MmtError
from mmt.evaluation.link_bench import (
    DirectionResult,
    KindResult,
    LinkBenchResult,
    _receive,
    bench_link,
)


def test_both_links_are_measured_and_lose_nothing() -> None:
    result = bench_link(0.5, rate_hz=200, rounds=1)
    for kind in (result.ours, result.bare):
        for direction in (kind.up, kind.down):
            # warm-up, measurement and settling at 200 Hz
            assert direction.messages >= 100
            assert direction.lost == direction.out_of_order == 0
            assert 0 < direction.p50_ms <= direction.p99_ms
        assert kind.leader_cores > 0
        assert kind.follower_cores > 0
    assert all(math.isfinite(ratio) and ratio > 0 for ratio in result.ratios.values())
    assert json.loads(json.dumps(result.as_dict()))["ours"]["up"]["lost"] == 0


def test_ratios_are_ours_over_bare() -> None:
    ours = KindResult(DirectionResult(2, 6, 1, 0, 0), DirectionResult(3, 8, 1, 0, 0), 0.4, 0.6)
    bare = KindResult(DirectionResult(1, 2, 1, 0, 0), DirectionResult(2, 2, 1, 0, 0), 0.2, 0.2)
    ratios = LinkBenchResult(1.0, 1000, 1, ours, bare).ratios
    assert ratios == pytest.approx(
        {
            "up_p50": 2,
            "up_p99": 3,
            "down_p50": 1.5,
            "down_p99": 4,
            "leader_cores": 2,
            "follower_cores": 3,
        }
    )


def test_a_process_that_dies_or_hangs_is_an_error() -> None:
    near, far = multiprocessing.Pipe()
    with pytest.raises(MmtError, match="gave nothing"):
        _receive(near, 0.01)
    far.close()
    with pytest.raises(MmtError, match="failed"):
        _receive(near, 1.0)
    near.close()


@pytest.mark.parametrize("given", [(0.0, 1000, 1), (1.0, 0, 1), (1.0, 1000, 0), (math.nan, 1, 1)])
def test_numbers_must_be_positive(given: tuple[float, int, int]) -> None:
    duration_s, rate_hz, rounds = given
    with pytest.raises(InputError, match="must be positive"):
        bench_link(duration_s, rate_hz, rounds=rounds)
