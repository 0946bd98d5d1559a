"""Methods side by side: sessions, judgement, statistics and the command."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.core.errors import InputError
from mmt.evaluation.document import Table
from mmt.evaluation.levels import BAND_EDGES_HZ, band_errors_db
from mmt.testing.simulation.textures import SURFACES
from mmt_lab.compare.cases import Case, recorded_cases, simulated_cases
from mmt_lab.compare.judging import FIGURES, METHODS, Judged, blocks_of, check_methods, judge
from mmt_lab.compare.summary import ALL_RUN_TO_RUN_DB, RUN_TO_RUN_DB, MethodComparison
from mmt_lab.experiments.compare import findings, method_blocks, verdicts
from mmt_lab.harness.experiment import chosen_textures
from mmt_lab.harness.report import write_report


def judged(method, seed, share, moment="stop", name="wood") -> Judged:
    figures = {**dict.fromkeys(FIGURES, 1.0), "within_jnd": share}
    return Judged("isotropic", name, name, seed, method, moment, 8.0, 20, figures, (1.0,) * 9)


def comparison(gains, base=0.7) -> MethodComparison:
    rows = []
    for seed, gain in enumerate(gains):
        rows += [judged("published", seed, base), judged("field", seed, base + gain)]
    return MethodComparison(("published", "field"), tuple(rows))


def test_bands_are_nine_of_one_ratio_and_see_a_gain_in_one_of_them_alone():
    frequencies = np.arange(10.0, 501.0, 2.0)
    ratios = BAND_EDGES_HZ[1:] / BAND_EDGES_HZ[:-1]
    np.testing.assert_allclose(ratios, 50.0 ** (1 / 9))
    reference = np.ones((3, len(frequencies)))
    louder = reference.copy()
    louder[1, (frequencies >= BAND_EDGES_HZ[5]) & (frequencies < BAND_EDGES_HZ[6])] = 10.0
    errors = band_errors_db(louder, reference, frequencies)
    assert errors.shape == (3, 9)
    assert errors[1, 5] == pytest.approx(10.0)
    assert np.abs(np.delete(errors.ravel(), 14)).max() < 1e-9


def test_every_known_texture_is_judged_with_as_many_seeds_as_asked():
    cases = simulated_cases(10, list(SURFACES))
    assert {case.texture for case in cases} == set(SURFACES)
    assert len(cases) == 10 * len(SURFACES)
    assert {case.inputs for case in cases if case.group == "grained"} == {"anisotropic"}


def test_an_unknown_texture_or_method_is_refused_in_words():
    with pytest.raises(InputError, match="surface is 'velvet', allowed are"):
        chosen_textures("velvet")
    for names in (["published"], ["field", "field"], ["published", "best"]):
        with pytest.raises(InputError, match="name two or more of published"):
            check_methods(names)


def make_stroke(path: Path, speed_mm_s: float) -> Path:
    time_s = np.arange(0.0, 4.0, 0.001)
    position = np.zeros((len(time_s), 3))
    position[:, 0] = speed_mm_s / (4 * np.pi) * np.sin(4 * np.pi * time_s)
    force = np.zeros_like(position)
    force[:, 2] = 0.6 + 0.3 * np.sin(2.7 * time_s)
    np.savez(path, time_s=time_s, position_mm=position, force_n=force)
    return path


def test_recorded_strokes_are_scaled_into_the_plane_and_others_left_out_with_a_reason(tmp_path):
    make_stroke(tmp_path / "slow.npz", 2.0)
    make_stroke(tmp_path / "usual.npz", 80.0)
    (tmp_path / "broken.npz").write_bytes(b"no zip")
    cases, remarks = recorded_cases([tmp_path, tmp_path / "absent"], ["wood", "oak"])
    assert [(case.name, case.texture, case.group) for case in cases] == [
        ("usual", "wood", "recorded strokes")
    ]
    assert cases[0].motion_scale == pytest.approx(200 / 80, rel=0.1)
    assert len(remarks) == 3
    assert "no stroking" in " ".join(remarks)
    assert "there is no recorded stroke" in remarks[-1]


def test_a_session_is_judged_the_same_each_time_and_by_the_moments_of_the_first(tmp_path):
    stroke = make_stroke(tmp_path / "usual.npz", 80.0)
    case = Case("wood", 3, stroke, 2.5, 2.0)
    short = replace(case, texture="felt")
    first = judge(short, ["published", "field"], blocks_of(short))
    assert first == judge(short, ["published", "field"], blocks_of(short))
    assert {one.moment for one in first} >= {"3 s", "30 s"}
    by_method = {m: [o.time_s for o in first if o.method == m] for m in ("published", "field")}
    assert by_method["published"] == by_method["field"]
    assert all(0.0 <= one.figures["within_jnd"] <= 1.0 for one in first)


def test_differences_are_paired_and_count_beyond_three_standard_errors():
    same = comparison([0.1, -0.1, 0.1, -0.1]).differences("wood")[0]
    assert (same.mean, same.verdict) == (pytest.approx(0.0), "same")
    better = comparison([0.10, 0.12, 0.11, 0.09]).differences("isotropic")[0]
    assert better.mean == pytest.approx(0.105)
    assert better.standard_error == pytest.approx(np.std([10, 12, 11, 9], ddof=1) / 200)
    assert better.verdict == "better"
    assert comparison([-0.10, -0.12, -0.11]).differences("wood")[0].verdict == "worse"
    assert comparison([0.5]).differences("wood")[0].verdict == "same"


def test_an_error_by_bands_is_also_a_multiple_of_what_a_surface_scatters_from_run_to_run():
    one = judged("field", 0, 0.7)
    off = {**one.figures, "band_error_db": 2.0 * ALL_RUN_TO_RUN_DB}
    off_bands = tuple(3.0 * scatter_db for scatter_db in RUN_TO_RUN_DB)
    twice = replace(one, figures=off, bands_db=off_bands)
    tables = [
        b for b in method_blocks(MethodComparison(("field",), (twice,))) if isinstance(b, Table)
    ]
    (figures,) = (t for t in tables if t.caption.startswith("isotropic: medians"))
    assert dict(zip(figures.columns, figures.rows[0], strict=True))["times run-to-run"] == "2.0"
    (bands,) = (t for t in tables if "each band's power" in t.caption)
    assert bands.rows[0][2:4] == ["2.61 (3.0)", "2.79 (3.0)"]
    assert all(cell.endswith("(3.0)") for cell in bands.rows[0][2:])


def test_rows_are_medians_with_their_spread_and_verdicts_name_what_is_missed():
    found = comparison([0.0, 0.1, 0.2])
    row = next(row for row in found.rows("wood") if row.method == "field")
    assert row.spread["within_jnd"].median == pytest.approx(0.8)
    assert row.spread["within_jnd"].low == pytest.approx(0.72)
    assert row.sessions == 3
    sentences = " ".join(verdicts(found))
    assert "at the stop criterion: on 0 of 1 textures, not on wood" in sentences


def test_a_report_holds_the_figures_and_the_settings(tmp_path):
    page = write_report(tmp_path, findings(comparison([0.1, 0.2, 0.3])))
    assert "a Gaussian process" in page.read_text()
    data = json.loads((tmp_path / "summary.json").read_text())
    assert len(data["sessions"]) == 6
    assert METHODS["published"]["method"] == "published"


def test_the_command_compares_on_named_textures(tmp_path):
    file = tmp_path / "figures.json"
    options = ["--seeds", "1", "--textures", "wood", "--workers", "1", "--json", str(file)]
    result = CliRunner().invoke(app, ["lab", "compare", *options])
    assert result.exit_code == 0, result.output
    data = json.loads(file.read_text())
    assert {row["moment"] for row in data["rows"]} == {"3 s", "start", "stop", "30 s"}
    assert "field at the start criterion" in " ".join(result.output.split())
