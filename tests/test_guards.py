"""Right before a device: what is no number fades out and in, and what is too large is cut."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.guards import ForceGuard, SampleGuard

BROKEN = st.sampled_from([math.nan, math.inf, -math.inf])
SAMPLES = st.one_of(BROKEN, st.floats(-4.0, 4.0), st.sampled_from([3.0, -3.0, 1e308]))


@given(st.lists(st.lists(SAMPLES, max_size=4), max_size=20))
def test_blocks_are_guarded_as_single_samples_are(blocks):
    guard, single = SampleGuard(3.0), SampleGuard(3.0, 10)
    for block in blocks:
        samples = np.array(block, dtype=float)
        guard.apply(samples)
        assert samples.tolist() == [single.step(value) for value in block]
    together = [abs(value) for block in blocks for value in block]
    assert guard.limited == single.limited == sum(3.0 < value < math.inf for value in together)
    assert guard.not_finite == single.not_finite == sum(not value < math.inf for value in together)


@given(st.floats(-3.0, 3.0), st.integers(1, 30), st.floats(-3.0, 3.0))
def test_what_is_no_number_fades_out_and_in_and_is_counted(before, count, after):
    guard = SampleGuard(3.0, 10)
    assert SampleGuard(3.0).step(math.nan) == 0.0
    signal = [*[before] * 3, *[math.nan] * count, *[after] * 20]
    played = [guard.step(value) for value in signal]
    assert guard.not_finite == count
    assert played[:3] == [before] * 3
    assert played[-8:] == [after] * 8
    steps = [abs(b - a) for a, b in pairwise(played[: 3 + count])]
    assert max(steps) <= abs(before) / 10 + 1e-12
    assert abs(played[3 + count]) <= max(abs(after), abs(before))
    if count >= 10:
        assert played[2 + count] == pytest.approx(0.0)
        assert max(abs(b - a) for a, b in pairwise(played[2 + count :])) <= abs(after) / 10 + 1e-9


@given(st.permutations([0.5, 2.0, math.nan]), BROKEN, st.integers(1, 15))
def test_a_force_that_is_no_number_fades_as_a_whole(force_n, broken, count):
    guard = ForceGuard(2.0, (1.0, 5.0, 1.0))
    good = (-3.0, 5e-3, 0.25)
    x, y, z = guard.step((-3.0, 4.0, 3.0))
    assert (x, y, z) == pytest.approx((-1.0 * 2 / 18**0.5, 4.0 * 2 / 18**0.5, 2 / 18**0.5))
    a, b, c = (value if value < 3.0 else broken for value in force_n)
    assert ForceGuard(2.0).step((a, b, c)) == (0.0, 0.0, 0.0)
    gains = [max(1.0 - 0.1 * k, 0.0) for k in range(1, count + 1)]
    for gain in gains:
        share = 0.5 * gain
        assert guard.step((a, b, c), 0.5) == pytest.approx((share * x, share * y, share * z))
    assert guard.not_finite == count
    for k in range(1, 12):
        share = min(gains[-1] + 0.1 * k, 1.0)
        assert guard.step(good) == pytest.approx((-share, 5e-3 * share, 0.25 * share))
