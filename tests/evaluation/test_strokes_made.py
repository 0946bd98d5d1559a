"""The strokes that were made, errors over them and over the plane, and figures across sessions."""

from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.core.frames import empty_frames
from mmt.evaluation.evaluate import evaluate_session
from mmt.evaluation.model_errors import LEAST_POWER, across, over_plane
from mmt.evaluation.reports import tables
from mmt.evaluation.strokes_made import MOST, StrokesMade
from mmt.evaluation.truth import KnownTexture
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt.texture.autoregression.forms import lsf_output_power
from mmt.texture.completion.distance import middles
from mmt.texture.online.history import build, stream_blocks
from mmt.texture.segmentation.segmenter import SampleRange
from mmt.texture.settings import JND_DB, ModellingSettings
from mmt.texture.signals.filtering import StreamFilter

SETTINGS = ModellingSettings()


def made_in(frames, size=1000):
    return StrokesMade.from_frames(np.split(frames, range(size, len(frames), size)), SETTINGS)


def test_strokes_are_those_in_contact_and_in_motion_whatever_the_blocks(simulated):
    made = made_in(simulated.frames)
    strokes = made.strokes()
    for one, other in zip(strokes, made_in(simulated.frames, 333).strokes(), strict=True):
        np.testing.assert_array_equal(one, other)
    motion = StreamFilter().process(simulated.frames)
    stroking = motion.valid & (motion.speed_mm_s >= 10.0) & (motion.normal_force_n >= 0.1)
    assert made.total_s == pytest.approx(stroking.sum() / 1000.0)
    assert len(strokes.force_n) == MOST
    assert strokes.speed_mm_s.min() >= 10.0
    assert strokes.force_n.min() >= 0.1
    everything = made.strokes(10**9)
    assert len(everything.force_n) == pytest.approx(made.total_s * 100, abs=20)
    assert np.median(strokes.force_n) == pytest.approx(
        np.median(motion.normal_force_n[stroking]), abs=0.05
    )
    heading = np.arctan2(*motion.velocity_mm_s[stroking].T[::-1])
    assert np.isin(strokes.heading_rad, heading).all()


def test_a_session_without_contact_has_no_strokes():
    frames = empty_frames(3000, ("position", "force", "acceleration"))
    frames["sequence"] = np.arange(3000)
    made = made_in(frames)
    assert made.total_s == 0.0
    assert len(made.strokes().force_n) == 0
    assert made.ranges() == (None, None)
    assert len(StrokesMade(SETTINGS).strokes().force_n) == 0


def test_errors_over_the_strokes_are_those_of_the_truth_at_each(simulated, known):
    model = known.model_at(8.0)
    strokes = made_in(simulated.frames).strokes()
    surface = get_surface("plastic")
    band_hz = np.linspace(8.0, 500.0, 2000)
    own, true = (
        np.trapezoid(density, band_hz, axis=1)
        for density in (
            model.spectrum(strokes.speed_mm_s, strokes.force_n, frequencies_hz=band_hz),
            surface.spectrum(strokes.speed_mm_s, strokes.force_n, band_hz),
        )
    )
    error_db = 10.0 * np.log10(own / true)
    end = known.at_end
    assert end.power_error_db == pytest.approx(np.sqrt(np.mean(error_db**2)), abs=0.02)
    assert end.within_jnd == pytest.approx(np.mean(np.abs(error_db) <= JND_DB), abs=0.02)
    plane_db = KnownTexture(surface).plane.level_errors_db(model)
    assert end.plane_within_jnd == np.mean(np.abs(plane_db) <= JND_DB)


def test_the_plane_reaches_from_the_least_stroke_to_the_end_in_equal_cells():
    strokes = over_plane()
    for values, low, high in ((strokes.speed_mm_s, 10, 300), (strokes.force_n, 0.1, 3)):
        axis = np.unique(values)
        assert (axis[0] - low) == pytest.approx(high - axis[-1])
        np.testing.assert_allclose(np.diff(axis), (high - low) / len(axis))


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e3), st.integers(1, 50))
def test_middles_integrate_a_straight_line_exactly(low, width, count):
    found = middles((low, low + width), count)
    assert found.mean() == pytest.approx(low + 0.5 * width, abs=1e-9 * (abs(low) + width))
    assert len(found) == count


def test_the_other_method_is_scored_as_if_it_were_the_scenes(simulated, known):
    published = evaluate_session(simulated, ModellingSettings(method="published"))
    assert (known.beside, published.beside) == ("published", "field")
    for one, other in ((known, published), (published, known)):
        for mine, its in zip(one.steps, other.steps, strict=True):
            for name, value in asdict(mine.beside).items():
                assert value == getattr(its, name)


def test_without_a_truth_the_other_method_is_scored_at_the_held_out_segments(simulated, unknown):
    taken = unknown.held_out
    settings = ModellingSettings(method="published")

    history = build(stream_blocks([simulated.frames], 1000), settings)
    spans = [(round(1000 * part.start_s), round(1000 * part.stop_s)) for part in taken]
    model = history.log.without([SampleRange(*span) for span in spans]).model(7)
    inputs = np.array([(part.speed_mm_s, part.force_n) for part in taken])
    lsf, variance = model.at(*inputs.T)
    power = lsf_output_power(variance, lsf)
    true = np.array([part.power for part in taken])
    error_db = 10.0 * np.log10(np.maximum(power, LEAST_POWER) / np.maximum(true, LEAST_POWER))
    beside = unknown.at_end.beside
    assert beside.power_error_db == pytest.approx(np.sqrt(np.mean(error_db**2)))
    assert beside.within_jnd == np.mean(np.abs(error_db) <= JND_DB)
    assert beside.plane_within_jnd is None


def test_figures_across_sessions():
    found = across([0.9, 0.1, 0.8, 0.4, 0.6, 0.7, 0.5])
    assert found.sessions == 7
    assert (found.median, found.below_half) == (0.6, 2)
    assert found.mean == pytest.approx(4.0 / 7)
    assert found.worst == pytest.approx((0.1 + 0.4 + 0.5 + 0.6 + 0.7) / 5)
    assert across([1.0, 7.0, 3.0, 3.0, 3.0, 3.0, 3.0], larger_is_better=False).worst == 3.8
    assert across([0.2]) == (1, 0.2, 0.2, 0.2, 1)


def test_the_table_of_levels_ends_with_what_holds_across_sessions(known, unknown):
    assert len(tables.levels([known]).rows) == 2
    rows = tables.levels([known, unknown]).rows
    assert len(rows) == 4 + 2 * 4
    share = np.mean([e.final.within_jnd for e in (known, unknown)])
    assert rows[5][0] == "mean"
    assert rows[5][3] == f"{100 * share:.0f} %"
    assert rows[5][5] == rows[0][5]  # of the one whose plane is known
    assert rows[7][2:] == ("-", "0", "-", "0")
