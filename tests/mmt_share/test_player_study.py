"""The player's two scenarios, what of a page's messages is believed, and its pictures."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from player_samples import flat_texture, rows_of

from mmt.core.errors import InputError, MmtError
from mmt_share.player.messages import LONGEST_STEP_MS, MOST_STEPS, Step, parse, steps_of
from mmt_share.player.player import SIZE, picture
from mmt_share.player.results import COLUMNS, ResultsFile
from mmt_share.player.study import Exploration, Matching, orders

NAMES = tuple("abcdefghi")


class Clock:
    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        self.now_s += 1.5
        return self.now_s


def a(scenario, path, participant="P1", seed=1):
    return scenario(NAMES, participant, seed, ResultsFile(path).write, Clock())


def test_orders_are_random_and_the_same_for_the_same_seed_and_participant():
    first = orders(1, "P1", "matching", 9)
    assert first == orders(1, "P1", "matching", 9)
    others = [orders(1, "P2", "matching", 9), orders(2, "P1", "matching", 9)]
    others.append(orders(1, "P1", "exploration", 9))
    assert all(other != first for other in others)
    assert all(sorted(order) == list(range(9)) for pair in (first, *others) for order in pair)


def test_every_place_of_an_order_is_as_likely():
    firsts = [orders(0, f"P{number}", "matching", 4)[0][0] for number in range(400)]
    assert all(60 <= firsts.count(tile) <= 140 for tile in range(4))  # 100 +- 4.6 deviations


def test_exploration_rates_one_pair_after_the_other(tmp_path):
    study = a(Exploration, tmp_path / "r.csv")
    for trial, texture in enumerate(study.order):
        assert study.state()["tile"] == texture
        assert [study.texture(tile) for tile in range(9)].count(None) == 8
        with pytest.raises(InputError, match="stroke"):
            study.rate(3)
        study.stroked(texture, 0.6)
        study.stroked(texture, 0.6)
        assert study.state()["rates"]
        study.rate(trial % 7 + 1)
    assert study.done
    with pytest.raises(InputError, match="all pairs"):
        study.rate(1)
    written = [row for row in rows_of(tmp_path / "r.csv") if row["event"] == "rating"]
    assert [int(row["trial"]) for row in written] == list(range(1, 10))
    assert [row["sample"] for row in written] == [NAMES[texture] for texture in study.order]
    assert [int(row["rating"]) for row in written] == [1, 2, 3, 4, 5, 6, 7, 1, 2]
    assert {row["participant"] for row in written} == {"P1"}
    assert all(float(row["stroked_s"]) == 1.2 for row in written)


def test_matching_counts_the_matches_and_hides_until_then(tmp_path):
    study = a(Matching, tmp_path / "r.csv")
    under = {tile: study.texture(tile) for tile in range(9)}
    right = {texture: tile for tile, texture in under.items()}
    assert sorted(right) == list(range(9))
    assert study.hidden
    assert study.state()["hidden"]
    for sample in range(9):
        study.answer(sample, right[sample])
    study.answer(0, right[1])  # takes it from 1
    with pytest.raises(InputError, match="1 samples have no tile"):
        study.finish()
    with pytest.raises(InputError, match="match all"):
        study.rate(4)
    study.answer(1, right[0])
    assert study.finish() == "7 of 9 match"
    assert study.state()["textures"] == [under[tile] for tile in range(9)]
    with pytest.raises(InputError, match="no match can be changed"):
        study.answer(1, right[1])
    study.rate(6)
    assert study.done
    written = rows_of(tmp_path / "r.csv")
    events = ["begin", *["answer"] * 11, "finish", "rating"]
    assert [row["event"] for row in written] == events
    assert [row["correct"] for row in written[1:13]] == ["1"] * 9 + ["0", "0", "7"]
    assert written[-1]["rating"] == "6"


def test_rows_are_added_to_what_there_is(tmp_path):
    path = tmp_path / "deep" / "r.csv"
    a(Exploration, path, "P1")
    a(Matching, path, 'P "2", x')
    assert [row["participant"] for row in rows_of(path)] == ["P1", 'P "2", x']
    assert path.read_text().count("time_utc") == 1
    assert path.read_text().splitlines()[0] == ",".join(COLUMNS)


def test_an_answer_that_cannot_be_written_is_not_taken(tmp_path):
    path = tmp_path / "r.csv"
    study = a(Exploration, path)
    study.stroked(study.order[0], 2.0)
    path.unlink()
    path.mkdir()
    with pytest.raises(MmtError, match="results"):
        study.rate(5)
    assert study.state()["trial"] == 1


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
    assert step == Step(10, 2.0, -3.0, 100.0, -50.0, 0.5)
    assert steps_of({"steps": []}) == []
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
            assert max(map(abs, step[1:5])) <= 1e4
            assert 0.0 <= step.force_n <= 100.0


@given(st.text(max_size=60))
def test_whatever_is_said_is_read_or_refused(text):
    with suppress(InputError):
        assert isinstance(parse(text)["do"], str)
