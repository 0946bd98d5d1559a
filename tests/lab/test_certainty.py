"""What a model says of its error against what it is: on a session, in tables, in words."""

import json

import numpy as np
import pytest

from mmt.texture.completion.uncertainty import completion_grid
from mmt.texture.settings import START_SHARE, STOP_SHARE
from mmt_lab.compare.cases import Case
from mmt_lab.compare.certainty import (
    DEVIATIONS_DB,
    Certainty,
    Outcome,
    Update,
    has_certainty,
    judge_certainty,
)
from mmt_lab.compare.certainty_tables import (
    SHARES,
    calibration_figure,
    calibration_sentence,
    calibration_table,
    criteria_table,
    deviation_table,
)
from mmt_lab.compare.judging import blocks_of
from mmt_lab.compare.summary import MethodComparison
from mmt_lab.experiments.compare import findings, method_tables
from mmt_lab.harness.report import write_report


def certainty(expected: list[float], true: list[float], *, start_s: float | None = 4.0):
    updates = tuple(
        Update(float(number), a, b, a, b)
        for number, (a, b) in enumerate(zip(expected, true, strict=True))
    )
    met = Outcome("start", start_s, 9, 0.8, 0.76, 0.78, 0.79, 0.9, 1.5)
    outcomes = (met if start_s is not None else Outcome("start"), Outcome("stop"))
    return Certainty(
        *("isotropic", "wood", "wood", 1000, "field"),
        updates,
        outcomes,
        squares=(4.0, 0.0, 50.0, 0.0, 0.0),
        counts=(4, 0, 200, 0, 0),
    )


def test_a_sessions_errors_are_counted_at_every_update_and_stroke():
    assert [has_certainty(name) for name in ("published", "field")] == [False, True]
    case = Case("felt", 3)
    blocks = blocks_of(case)[:7]
    found = judge_certainty(case, "field", blocks)
    assert found == judge_certainty(case, "field", blocks)
    assert sum(found.counts) == len(found.updates) * len(completion_grid(2))
    assert len(found.counts) == len(DEVIATIONS_DB) - 1
    for update in found.updates:
        for share in (update.expected, update.true, update.expected_even, update.true_even):
            assert 0.0 <= share <= 1.0 + 1e-9
    start, stop = found.outcomes
    assert (start.threshold, stop.threshold) == ("start", "stop")
    assert start.expected is not None
    assert stop.expected is not None
    assert START_SHARE <= start.expected < 1.0
    assert STOP_SHARE <= stop.expected < 1.0
    assert start.time_s <= stop.time_s <= 7.0
    assert start.to_come is not None


def test_shares_are_gathered_by_what_was_expected():
    table = calibration_table([certainty([0.55, 0.57, 0.99], [0.5, 0.7, 1.0])], "caption")
    assert [row[:4] for row in table.rows] == [
        ["0.5 to 0.6", "2", "0.560", "0.600"],
        ["0.98 to 1", "1", "0.990", "1.000"],
    ]
    at_the_ends = calibration_table([certainty([0.0, 1.0], [0.0, 1.0])], "caption")
    assert sum(int(row[1]) for row in at_the_ends.rows) == 2
    assert SHARES[0] == 0.0
    sentence = calibration_sentence([certainty([0.5, 0.6], [0.6, 0.8])], "field")
    assert "over 2 updates" in sentence
    assert "+0.150" in sentence
    assert "0.158" in sentence  # the root of the mean of 0.1^2 and 0.2^2
    assert "no model says" in calibration_sentence([certainty([], [])], "field")


def test_standardised_errors_are_roots_of_means():
    rows = deviation_table([certainty([0.5], [0.5])] * 2, "caption").rows
    assert rows[0] == ["wood", "1.00", "-", "0.50", "-", "-", "0.51"]
    assert rows[-1] == ["all", *rows[0][1:]]


def test_a_threshold_that_is_not_met_counts_as_that():
    sessions = [certainty([0.5], [0.5]), certainty([0.5], [0.5], start_s=None)]
    rows = {row[0]: row for row in criteria_table(sessions, "caption").rows}
    assert rows["start"][1:] == [
        *("1 of 2", "4.0", "9", "0.76", "0.78", "0.79", "0.80", "0.900", "1.50")
    ]
    assert rows["stop"][1:] == ["0 of 2", *["-"] * 8]


def test_the_figure_has_a_panel_for_each_group_and_the_means_of_bands():
    random = np.random.default_rng(1)
    expected = random.uniform(0.5, 0.6, 40).tolist()
    figure = calibration_figure([certainty(expected, [0.5] * 40)])
    (axis,) = figure.axes
    assert axis.get_title() == "isotropic"
    np.testing.assert_allclose(axis.lines[1].get_xydata(), [[np.mean(expected), 0.5]])
    assert calibration_figure([certainty([0.5], [0.5])]).axes[0].get_xlim() == (0.0, 1.02)


@pytest.mark.parametrize("count", [0, 1])
def test_a_report_says_how_sure_a_method_is_where_one_knows(tmp_path, count):
    sure = tuple(certainty([0.5, 0.9], [0.6, 0.9]) for _ in range(count))
    found = MethodComparison(("published", "field"), (), certainties=sure)
    write_report(tmp_path, findings(found))
    text = (tmp_path / "report.md").read_text()
    assert ("How sure field is" in text) == bool(count)
    assert (tmp_path / "figures" / "calibration-field.png").exists() == bool(count)
    data = json.loads((tmp_path / "summary.json").read_text())
    assert len(data["certainty"]) == count
    assert len(method_tables(found)) == 2 * count
