"""Errors by heading: of the truth's own mean, and of sessions on textures with a grain."""

import json

import numpy as np
import pytest

from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.model_errors import GridErrors, Strokes, all_headings, by_heading
from mmt.evaluation.reports.document import as_text
from mmt.evaluation.reports.report import write_report
from mmt.evaluation.reports.tables import heading_tables
from mmt.evaluation.truth import KnownTexture
from mmt.scene import Hand, Scene
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.modes import Grain, Resonance
from mmt.testing.simulation.surfaces.surface import Surface
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt.texture.settings import ModellingSettings


def session_on(name, duration_s=7.0):
    frames, truth = simulate_session(Scene(hand=Hand(headings="all")), name, duration_s, 1)
    return RecordedSession(frames=frames, annotations=truth)


@pytest.fixture(scope="module")
def ridged():
    return evaluate_session(session_on("ridged-plastic"))


def test_grid_has_every_sector_alike_and_no_heading_along_an_axis():
    strokes = all_headings()
    np.testing.assert_array_equal(np.bincount(strokes.sector), [72] * 12)
    assert np.abs(np.sin(4.0 * strokes.heading_rad)).min() > 0.4
    turned = Strokes(strokes.speed_mm_s, strokes.force_n, strokes.heading_rad - 2.0 * np.pi)
    np.testing.assert_array_equal(turned.sector, strokes.sector)


def test_errors_are_gathered_sector_by_sector():
    strokes = all_headings()
    sectors = strokes.sector
    errors = GridErrors(
        gfc=1.0 - 0.01 * sectors,
        power_error_db=np.where(np.arange(864) % 2, 1.0, -1.0) * sectors,
        log_spectral_db=3.0 * sectors,
        bands_db=np.zeros((864, 9)),
    )
    found = by_heading("some", strokes, errors)
    assert [sector.heading_deg for sector in found.sectors] == list(range(15, 360, 30))
    for number, sector in enumerate(found.sectors):
        assert sector.gfc == pytest.approx(1.0 - 0.01 * number)
        assert sector.log_spectral_db == pytest.approx(3.0 * number)
        assert sector.power_error_db == pytest.approx(number)
        assert sector.power_bias_db == pytest.approx(0.0, abs=1e-12)
        assert sector.within_jnd == (number <= 1)
    assert found.overall.heading_deg is None
    assert found.overall.within_jnd == pytest.approx(2 / 12)
    squares = np.square([sector.power_error_db for sector in found.sectors])
    assert found.overall.power_error_db == pytest.approx(np.sqrt(squares.mean()))


def test_the_mean_over_headings_is_right_where_the_power_alone_turns():
    """With a nap alone, the shape is the same to and fro; the level is known in closed form."""
    surface = Surface("nap", (Resonance(1.0, 1.0, 1.0, 120.0, 80.0, grain=Grain(0.0, 1.0, 0.5)),))
    truth = KnownTexture(surface)
    errors = truth.without_heading()
    expected_db = -10.0 * np.log10(1.0 + 0.5 * np.cos(truth.plane.strokes.heading_rad))
    np.testing.assert_allclose(errors.power_error_db, expected_db, atol=1e-9)
    np.testing.assert_allclose(errors.log_spectral_db, np.abs(expected_db), atol=1e-9)
    np.testing.assert_allclose(errors.gfc, 1.0)


def test_a_model_that_does_not_know_the_heading_misses_what_the_heading_does(ridged):
    model, _, mean = ridged.by_heading
    assert (model.model, mean.model) == ("speed and force", "mean over headings")
    assert mean.overall.power_error_db > 2.0
    assert model.overall.power_error_db > 0.9 * mean.overall.power_error_db
    across, along = model.sectors[0], model.sectors[2]
    assert along.power_bias_db - across.power_bias_db > 3.0
    assert ridged.final.plane_power_error_db == pytest.approx(model.overall.power_error_db)
    assert ridged.final.truth_gfc == pytest.approx(model.overall.gfc)
    assert {"heading"} <= {point.limit for point in ridged.worst} <= {"heading", "field"}
    assert all(0.0 < point.heading_deg < 360.0 for point in ridged.worst)
    assert ridged.power_map.power_error_db.shape == (6, 6)
    rms = np.sqrt(np.mean(ridged.power_map.power_error_db**2))
    assert rms == pytest.approx(model.overall.power_error_db)


def test_by_heading_is_in_tables_report_and_json(ridged, tmp_path):
    write_report(tmp_path, [ridged])
    assert (tmp_path / "figures" / "headings.png").exists()
    assert "mean over headings power" in (tmp_path / "report.md").read_text(encoding="utf-8")
    model, _, _ = json.loads((tmp_path / "summary.json").read_text("utf-8"))["by_heading"]
    assert len(model["sectors"]) == 12
    assert model["overall"]["heading_deg"] is None
    (table,) = heading_tables([ridged])
    shown = [line.split() for line in as_text(table).splitlines() if len(line) <= 80]
    assert all(list(row) in shown for row in table.rows)


def test_a_model_that_knows_the_heading_is_nearer_to_the_texture(tmp_path):
    session = session_on("ridged-plastic", 14.0)
    directed = evaluate_session(session, ModellingSettings(inputs="anisotropic"))
    knowing, unaware, mean = directed.by_heading
    assert (knowing.model, unaware.model) == ("velocity and force", "speed and force")
    assert mean.model == "mean over headings"
    assert knowing.overall.power_error_db < 0.8 * unaware.overall.power_error_db
    assert knowing.overall.log_spectral_db < unaware.overall.log_spectral_db
    assert directed.final.plane_power_error_db == pytest.approx(knowing.overall.power_error_db)
    assert all(point.limit != "heading" for point in directed.worst)
    assert directed.start_s is not None
    assert len(directed.coverage.cells) == 27
    headings = [cell.heading_deg for cell in directed.coverage.cells]
    assert headings.count(None) == 3
    assert "mm/s at " in directed.coverage.remark
    for segment in directed.held_out:
        assert 0.5 < segment.gfc <= 1.0
        assert segment.truth is not None
    write_report(tmp_path, [directed])
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "seen along the force" in text
    assert (tmp_path / "figures" / "model.png").exists()


def test_isotropic_textures_have_no_errors_by_heading():
    evaluation = evaluate_session(session_on("felt", 4.0))
    assert evaluation.by_heading == ()
    assert heading_tables([evaluation]) == []
    assert all(point.heading_deg is None for point in evaluation.worst)
    assert KnownTexture(get_surface("felt")).plane.strokes.speed_mm_s.shape == (144,)
