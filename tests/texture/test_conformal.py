"""Bets against exchangeability, and the mean time between false alarms, against closed forms."""

import numpy as np
import pytest

from mmt.texture.surfaces.conformal import (
    LARGEST_WIN,
    ConformalBets,
    ShiryaevRoberts,
    log_shift_ratios,
)

SIZE = 3
WHITE = np.eye(SIZE)


def innovations(kind: str, count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    if kind == "normal":
        return random.standard_normal((count, SIZE))
    if kind == "cauchy":
        return random.standard_cauchy((count, SIZE))
    return np.exp(1.5 * random.standard_normal((count, SIZE)))


@pytest.mark.parametrize("kind", ["normal", "cauchy", "skew"])
def test_bets_win_nothing_in_the_mean_whatever_the_scatter(kind: str) -> None:
    """Summed over which of the values came last their bets are exactly their number."""
    values = innovations(kind, 40, 1)
    recent = innovations(kind, 6, 2)
    ratios = log_shift_ratios(values, recent)
    total = 0.0
    for last in range(len(values)):
        bets = ConformalBets(SIZE)
        bets._earlier = np.delete(values, last, axis=0)
        bet = bets.log_bet(np.vstack([recent, values[last]]), WHITE)
        expected = ratios[last] - np.logaddexp.reduce(ratios) + np.log(len(values))
        assert bet == pytest.approx(expected)
        total += np.exp(bet)
    assert total == pytest.approx(len(values))


def test_a_shift_that_others_suggest_is_bet_on_in_its_direction() -> None:
    along, against = np.array([[2.0, 0.0, 0.0], [-2.0, 0.0, 0.0]])
    recent = np.tile([2.0, 0.0, 0.0], (8, 1))
    there, back = log_shift_ratios(np.array([along, against]), recent)
    assert there > 1.0
    assert back < -1.0
    same = log_shift_ratios(np.array([along, against]), np.zeros((0, SIZE)))
    assert same[0] == pytest.approx(same[1])


def alarms(values: np.ndarray, earlier: np.ndarray, threshold: float) -> list[int]:
    bets = ConformalBets(SIZE)
    bets.add(earlier)
    watch = ShiryaevRoberts(np.log(threshold))
    found = []
    for count in range(1, len(values) + 1):
        if watch.update(bets.log_bet(values[max(count - 25, 0) : count], WHITE)):
            found.append(count)
            watch.reset()
    return found


@pytest.mark.parametrize("kind", ["normal", "cauchy", "skew"])
def test_between_false_alarms_there_are_as_many_observations_as_asked_for(kind: str) -> None:
    threshold = 400.0
    number = 3000
    values, earlier = innovations(kind, number, 3), innovations(kind, 500, 4)
    assert len(alarms(values, earlier, threshold)) <= 2.0 * number / threshold


def test_a_shift_is_found_soon() -> None:
    """No test is quicker in the mean than the threshold over the divergence (Lorden 1971)."""
    threshold, shift = 1e5, 3.0
    bound = np.log(threshold) / (0.5 * shift**2)
    delays = []
    for seed in range(10):
        values = innovations("normal", 60, seed)
        values[:, 0] += shift
        delays.append(alarms(values, innovations("normal", 400, 100 + seed), threshold)[0])
    assert bound <= np.mean(delays) <= 4.0 * bound


def test_the_statistic_is_the_sum_over_change_points_of_the_products_of_bets() -> None:
    bets = [2.0, 0.5, 3.0]
    watch = ShiryaevRoberts(100.0)
    for bet in bets:
        watch.update(np.log(bet), weight=2.0)
    products = [bets[0] * bets[1] * bets[2], bets[1] * bets[2], bets[2]]
    assert np.exp(watch.log_statistic) == pytest.approx(2.0 * sum(products))


def test_one_run_raises_no_alarm_and_two_do() -> None:
    watch = ShiryaevRoberts(12.0)
    assert not any(watch.update(4.0, new_run=first) for first in [True, *[False] * 20])
    assert LARGEST_WIN * 12.0 <= watch.log_statistic < 12.0
    assert any(watch.update(4.0, new_run=first) for first in [True, False])
