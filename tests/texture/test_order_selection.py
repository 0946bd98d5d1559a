import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import burg, choose_order
from mmt.texture.autoregression.simulation import simulate_ar


def segments(order, count=5, samples=300, seed=0):
    generator = np.random.default_rng(seed)
    reflection = generator.uniform(-0.5, 0.5, order)
    reflection[-1] = 0.45
    return [simulate_ar(reflection, 0.1 + index, samples, generator) for index in range(count)]


@pytest.mark.parametrize("order", [4, 6, 9, 14, 20])
def test_the_order_of_a_known_model_is_found(order):
    chosen = [choose_order(segments(order, seed=seed)) for seed in range(10)]
    assert np.median(chosen) == order
    assert max(chosen) <= order + 4


def test_the_level_and_the_sequence_of_segments_do_not_matter():
    pieces = segments(7)
    assert choose_order(pieces[::-1]) == choose_order([1e-9 * piece for piece in pieces])


def test_one_segment_follows_the_published_criterion():
    piece = segments(5, count=1, samples=60)[0]
    scores = []
    for order in range(1, 25):
        v = [1 / (60 + 1 - i) for i in range(1, order + 1)]
        finite = np.prod([(1 + each) / (1 - each) for each in v]) - 1
        scores.append(np.log(burg(piece, order).variance) + max(finite, 3 * sum(v)))
    assert choose_order([piece], largest=24, smallest=1) == 1 + int(np.argmin(scores))


def test_white_noise_needs_the_smallest_order():
    noise = list(np.random.default_rng(1).standard_normal((6, 400)))
    assert choose_order(noise) == 4
    assert choose_order(noise, largest=12, smallest=2) == 2


def test_segments_of_zero_power_say_nothing():
    pieces = segments(8)
    assert choose_order([*pieces, np.zeros(500)]) == choose_order(pieces)
    assert choose_order([np.zeros(100)], smallest=3) == 3


@given(samples=st.integers(25, 60), seed=st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_short_and_predictable_segments_stay_within_the_bounds(samples, seed):
    n = np.arange(samples)
    noise = np.random.default_rng(seed).standard_normal(samples)
    for pieces in ([noise], [np.sin(0.3 * n)], [np.ones(samples), noise]):
        assert 4 <= choose_order(pieces) <= 24


@pytest.mark.parametrize(("largest", "smallest"), [(3, 4), (24, 0), (65, 4)])
def test_impossible_bounds_are_refused(largest, smallest):
    with pytest.raises(InputError):
        choose_order([np.ones(100)], largest=largest, smallest=smallest)


def test_a_segment_shorter_than_the_largest_order_is_refused():
    with pytest.raises(InputError, match="segment 1"):
        choose_order([np.ones(100), np.ones(24)])
