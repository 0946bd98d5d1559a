"""The tables and figures of papers A, B and C come from nothing but a seed."""

from dataclasses import replace

import numpy as np
import pytest
from lab_runs import run_lab

from mmt.texture.signals.metrics import Spectra
from mmt_lab.experiments import paper_b, paper_c
from mmt_lab.experiments.paper_a import COMPLETE_S, PUBLISHED, run
from mmt_lab.matching import RENEWAL_SAMPLES, real_sample, virtual_texture
from mmt_lab.selection import table_two
from mmt_lab.selection.concatenated import ROWS, data_set, recording
from mmt_lab.selection.table_two import AS_PUBLISHED, ORDER, VARIATIONS
from mmt_methods.selection.published import select_published


def test_the_table_and_the_figures_of_paper_a_are_made(tmp_path):
    report = ("--report", str(tmp_path / "report"))
    found, output = run_lab(tmp_path, "paper-a", "--seeds", "2", *report)
    for texture in found["textures"].values():
        steps = texture["steps"]
        assert [step["time_s"] for step in steps] == [2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5]
        distances = [step["distance"] for step in steps]
        assert distances == sorted(distances, reverse=True)  # a model only grows
        assert steps[-1]["gfc"] > 0.9
    assert found["one_hand"] < 0.1  # of sums of 3 to 10
    names = {path.name for path in (tmp_path / "report" / "figures").iterdir()}
    assert {"fig-4.png", "fig-3-wood.png", "fig-5-wood.png"} <= names
    judged = {target["what"]: target for target in found["judged"]}
    sums = [what for what in judged if ": distance at " in what]
    assert len(sums) == sum(map(len, PUBLISHED.values()))
    assert sum(judged[what]["met"] for what in sums) >= 21  # three of four
    assert judged["S4: distance at 2.5 s"]["met"] is False
    assert "not met: " in output
    for name, at_s in COMPLETE_S.items():
        if at_s is None:
            assert judged[f"{name}: last distance"]["met"]
        else:
            assert judged[f"{name}: complete after (s)"]["bound"] == at_s
    assert judged["lowest GFC of complete models"]["met"]
    assert judged["segments at the start"]["measured"] == pytest.approx(10.0, abs=3.0)


def test_raw_fourier_amplitudes_stay_below_what_the_paper_found_good():
    found = run(seeds=1, seed=2, spectra=Spectra.FOURIER)
    for texture in found.data["textures"].values():
        assert all(step["gfc"] < 0.85 for step in texture["steps"])
    assert not any("GFC" in target.what for target in found.targets)
    assert any("0.79" in sentence for sentence in found.sentences)


CHOSEN = ("felt", "oak", "corduroy")


def test_the_tables_and_spectra_of_paper_b_are_made(tmp_path, monkeypatch):
    monkeypatch.setattr(paper_b, "TEXTURES", CHOSEN)
    found, output = run_lab(tmp_path, "paper-b", "--report", str(tmp_path / "report"))
    assert all(words in output for words in ("Matching test", "Model sizes", "not met: "))
    assert found["matched"] == len(CHOSEN)
    judged = {target["what"]: target for target in found["judged"]}
    assert judged["pairs that match, of nine"]["met"]
    assert judged["filters estimated at (Hz)"]["measured"] == 100.0
    assert judged["output at (Hz)"]["met"]
    assert judged["vibration to (Hz)"]["met"]
    assert judged["levels of the pen's pressure"]["met"] is None
    for name in CHOSEN:
        own = found["pairs"][name][name]["error"]
        assert own == min(pair["error"] for pair in found["pairs"][name].values())
        assert found["two_renderings"][name]["error"] < own + 0.02
        assert found["sizes"][name]["file_bytes"] < found["sizes"][name]["recorded_bytes"] / 50
    speed_alone = {name: found["of_speed"][name]["error"] for name in CHOSEN}
    own = {name: found["pairs"][name][name]["error"] for name in CHOSEN}
    assert speed_alone["corduroy"] > own["corduroy"] + 0.1
    assert speed_alone["felt"] == pytest.approx(own["felt"], abs=0.05)
    assert (tmp_path / "report" / "figures" / "spectra.png").exists()


def test_the_filter_is_renewed_a_hundred_times_a_second():
    felt, sample = virtual_texture("felt", 0), real_sample("felt", 1)
    rendered = sample.rendered(felt.model, 3)
    assert len(rendered) == len(sample.vibration_m_s2)
    between = np.arange(len(rendered)) % RENEWAL_SAMPLES != 0
    changed = sample.velocity_mm_s.copy()
    changed[between] = 0.0
    held = replace(sample, velocity_mm_s=changed)
    np.testing.assert_array_equal(held.rendered(felt.model, 3), rendered)
    changed[~between] *= 0.5
    assert not np.array_equal(held.rendered(felt.model, 3), rendered)


PLANE = replace(ROWS[0], points=60, outliers=6)
SPACE = replace(ROWS[2], points=70, outliers=7)


@pytest.fixture(scope="module")
def recordings():
    return {row.name: recording(row, 3) for row in (PLANE, SPACE)}


@pytest.mark.parametrize("row", [PLANE, SPACE], ids=lambda row: row.surface)
def test_a_data_set_is_made_of_trials_and_knocks_add_their_share_of_the_power(row, recordings):
    recorded = recordings[row.name]
    assert recorded.trials == 2
    clean, quiet, loud = (data_set(row, 3, recorded, share=share) for share in (0.0, 0.4, 0.8))
    assert quiet.data.points.shape == (row.points, 3 if row.directed else 2)
    assert quiet.knocked.sum() == row.outliers
    np.testing.assert_array_equal(quiet.data.points, clean.data.points)
    power, quieter, louder = (
        np.array([np.mean(segment**2) for segment in each.data.segments])
        for each in (clean, quiet, loud)
    )
    assert np.median((quieter / power)[quiet.knocked]) == pytest.approx(1.4, abs=0.2)
    assert np.median((louder / power)[quiet.knocked]) == pytest.approx(1.8, abs=0.3)
    assert np.median((quieter / power)[~quiet.knocked]) == pytest.approx(1.0, abs=1e-6)


def test_as_published_is_the_published_selection_and_variations_differ(recordings):
    found = data_set(SPACE, 3, recordings["Wood"], ORDER)
    result, removed = table_two.select_with_variation(VARIATIONS[AS_PUBLISHED], found)
    expected = select_published(found.data)
    np.testing.assert_array_equal(result.outlier, expected.outlier)
    assert removed.detected == expected.outlier[found.knocked].mean()
    through, _ = table_two.select_with_variation(VARIATIONS["network through every point"], found)
    assert not np.array_equal(through.outlier, expected.outlier)


def test_the_tables_of_paper_c_are_made_with_the_papers_numbers_beside(tmp_path, monkeypatch):
    monkeypatch.setattr(paper_c, "ROWS", (PLANE, SPACE))
    found, output = run_lab(tmp_path, "paper-c", "--seeds", "1", "--workers", "1")
    for words in ("paper, Grass", "paper, Wood", "Table I: data sets", "Table II", "Fig. 4"):
        assert words in output
    for row in (PLANE, SPACE):
        (one,) = found["textures"][row.name]
        assert 3 <= one["minimal"] < one["points"] == row.points
        assert set(one["variations"]) == set(VARIATIONS)
        assert one["gain"] == pytest.approx(one["gfc"][1] / one["gfc"][0] - 1.0)
    assert found["published"]["Wood"]["kept"] == 202
    judged = {target["what"]: target for target in found["judged"]}
    detected = judged["Grass: detected, published"]
    assert detected["bound"] == 3.0  # 18 in the paper, of the six knocks here
    assert detected["met"] is False
    assert "Grass: detected, published" in output.replace("\n", " ")
    assert "not met: " in output
