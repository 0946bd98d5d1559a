"""What of a page's messages is believed, and the pictures that it shows."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from player_samples import flat_texture

from mmt.core.errors import InputError
from mmt_share.player.messages import LONGEST_STEP_MS, MOST_STEPS, Step, parse, steps_of
from mmt_share.player.player import SIZE, picture


def test_pictures_differ_and_show_the_grain():
    first, second = picture(flat_texture(1.0, 0.2)), picture(flat_texture(1.0, 1.6))
    for relief in (first, second):
        assert relief.shape == (SIZE, SIZE)
        assert np.isfinite(relief).all()
        assert (relief.mean(), relief.std()) == pytest.approx((0.0, 1.0), abs=1e-6)
    assert np.abs(np.diff(second)).mean() > 1.2 * np.abs(np.diff(first)).mean()


GOOD = [10, 2.0, -3.0, 100.0, -50.0, 0.5]


def test_a_stroke_is_read_and_what_makes_no_sense_in_it_refused():
    (step,) = steps_of({"steps": [GOOD]})
    assert step == Step(10, (2.0, -3.0), (100.0, -50.0), 0.5)
    assert steps_of({"steps": []}) == ()
    wrong = [None, {}, "[]", [GOOD] * (MOST_STEPS + 1)]
    wrong += [[GOOD, step] for step in (GOOD[:5], [0, *GOOD[1:]], [*GOOD, 1])]
    for value in (None, "1", True, [], float("nan"), float("inf"), -float("inf"), 10**400, 1e9):
        wrong += [[GOOD, [*GOOD[:k], value, *GOOD[k + 1 :]]] for k in range(6)]
    for steps in wrong:
        with pytest.raises(InputError):
            steps_of({"steps": steps})


values = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3))


@given(st.lists(st.lists(values, min_size=5, max_size=7), max_size=3))
def test_whatever_a_stroke_says_it_is_bounded_or_refused(steps):
    with suppress(InputError):
        for step in steps_of({"steps": steps}):
            assert 1 <= step.duration_ms <= LONGEST_STEP_MS
            assert max(map(abs, step.position_mm)) <= 1e4
            assert max(map(abs, step.velocity_mm_s)) <= 1e4
            assert 0.0 <= step.force_n <= 100.0


@given(st.text(max_size=60))
def test_whatever_is_said_is_read_or_refused(text):
    with suppress(InputError):
        assert isinstance(parse(text)["do"], str)
