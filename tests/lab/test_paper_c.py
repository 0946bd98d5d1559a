"""Paper C's tables come from nothing but a seed, on trials that are strung together."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.texture.selection import select_published
from mmt_lab.experiments import paper_c
from mmt_lab.selection import concatenated
from mmt_lab.selection.concatenated import data_set, segments_of, settings_of
from mmt_lab.selection.running import Row

PLANE = Row("Grass", "sandpaper", 60, 6, directed=False)
SPACE = Row("Wood", "oak", 70, 7, directed=True)


@pytest.mark.parametrize("row", [PLANE, SPACE], ids=lambda row: row.surface)
def test_a_data_set_is_made_of_trials_and_knocks_add_four_tenths_of_the_power(row, monkeypatch):
    knocked = data_set(row, 3)
    monkeypatch.setattr(concatenated, "_plant", lambda *_: None)
    clean = data_set(row, 3)
    assert knocked.trials == clean.trials == 2
    assert knocked.data.points.shape == (row.points, 3 if row.directed else 2)
    assert knocked.knocked.sum() == row.outliers
    np.testing.assert_array_equal(knocked.data.points, clean.data.points)
    power = [
        np.array([np.mean(segment**2) for segment in each.data.segments])
        for each in (knocked, clean)
    ]
    ratio = power[0] / power[1]
    assert np.median(ratio[knocked.knocked]) == pytest.approx(1.4, abs=0.2)
    assert np.median(ratio[~knocked.knocked]) == pytest.approx(1.0, abs=1e-6)


def test_trials_are_one_sequence_in_which_the_clock_runs_on():
    trials = [concatenated.stroke(PLANE, 1.0, seed) for seed in (1, 2)]
    frames = concatenated._joined(trials)
    np.testing.assert_array_equal(frames["sequence"], np.arange(2000))
    assert set(np.diff(frames["time_ns"])) == {1_000_000}
    assert segments_of(frames, settings_of(PLANE))


def test_the_tables_of_paper_c_are_made_with_the_papers_numbers_beside(tmp_path, monkeypatch):
    monkeypatch.setattr(paper_c, "ROWS", (PLANE, SPACE))
    done = CliRunner().invoke(app, ["lab", "paper-c", "--json", str(tmp_path / "c.json")])
    assert done.exit_code == 0, done.output
    for words in ("paper, Grass", "paper, Wood", "Table I: data sets", "Table II", "Fig. 4"):
        assert words in done.output
    found = json.loads((tmp_path / "c.json").read_text())
    for row in (PLANE, SPACE):
        one = found["textures"][row.name]
        assert 3 <= one["minimal"] <= one["kept"] < one["points"] == row.points
        assert one["detected"] <= row.outliers
        assert one["gain"] == pytest.approx(one["gfc"][1] / one["gfc"][0] - 1.0)
        result = select_published(data_set(row, 1).data)
        assert one["kept"] == result.kept.sum()
    assert found["published"]["Wood"] == {
        "minimal": 72,
        "detected": 32,
        "kept": 202,
        "gain": -0.051,
    }
