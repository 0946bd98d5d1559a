"""Whole sessions whose answers are known: made stroke by stroke, or simulated."""

import json
from dataclasses import replace

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.core.frames import empty_frames
from mmt.evaluation.evaluate import evaluate_session, evaluate_surfaces
from mmt.evaluation.reports.report import write_report
from mmt.evaluation.results import evaluations_as_dict
from mmt.scene import Scene
from mmt.scene.files import scene_from_tables
from mmt.session.data import RecordedSession
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.completion.distance import cells_of
from mmt.texture.online.history import build_model, stream_blocks
from mmt.texture.settings import ModellingSettings

SETTINGS = ModellingSettings(order=8, method="published")
KEYS = ("time_s", "samples", "distance", "gfc", "gfc_ceiling", "power_error_db", "within_jnd")


@pytest.fixture(scope="module")
def evaluation(stroked_session):
    return evaluate_session(stroked_session, SETTINGS)


def test_even_texture_scores_its_ceiling(evaluation):
    final = evaluation.final
    assert evaluation.basis == "held-out"
    assert final.gfc == pytest.approx(final.gfc_ceiling, abs=0.02)
    assert final.power_error_db < 1.5
    assert final.within_jnd >= 0.6
    assert final.truth_gfc is None


def test_criteria_agree_with_the_distances(evaluation):
    time_s, distance = evaluation.course.T
    for met_s, threshold in (
        (evaluation.start_s, SETTINGS.distances.start),
        (evaluation.stop_s, SETTINGS.distances.stop),
    ):
        assert met_s == time_s[np.argmax(distance <= threshold)]
    assert evaluation.at_start.time_s == evaluation.start_s
    assert evaluation.at_stop.distance <= SETTINGS.distances.stop < evaluation.at_start.distance


def test_steps_stand_every_step_and_show_the_last_update(evaluation):
    duration_s = evaluation.duration_s
    assert [step.time_s for step in evaluation.steps] == [2.5, 5.0, 7.5]
    assert duration_s == pytest.approx(27 * 0.35)
    by_time = dict(evaluation.course)
    mean_ms, longest_ms = evaluation.update_ms
    assert 0.0 < mean_ms <= longest_ms
    assert evaluation.steps[0].distance == by_time[2.0]
    assert evaluation.steps[1].distance == by_time[5.0]
    assert evaluation.at_end.distance == evaluation.course[-1, 1]
    samples = [step.samples for step in evaluation.steps]
    assert samples == sorted(samples)


def test_same_input_gives_the_same_figures(stroked_session, evaluation):
    again = evaluate_session(stroked_session, SETTINGS)
    assert _figures(again) == _figures(evaluation)
    other = evaluate_session(stroked_session, SETTINGS, seed=1)
    assert _figures(other)["held_out"] != _figures(evaluation)["held_out"]
    assert other.stop_s == evaluation.stop_s


def _figures(evaluation):
    figures = evaluation.as_dict()
    del figures["processing_s"], figures["times_real_time"]
    for score in (*figures["steps"], figures["at_start"], figures["at_stop"], figures["at_end"]):
        if score is not None:
            del score["update_ms"]
    return figures


def test_json_has_the_promised_keys(evaluation):
    one = json.loads(json.dumps(evaluations_as_dict([evaluation]), allow_nan=False))
    assert {"start_s", "stop_s", "steps", "sessions", "definitions"} <= set(one)
    assert all(set(step) >= set(KEYS) for step in one["steps"])
    assert one["sessions"][0]["steps"] == one["steps"]
    two = evaluations_as_dict([evaluation, evaluation])
    assert len(two["sessions"]) == 2
    assert "steps" not in two


def test_known_texture_is_the_basis(known):
    assert known.basis == "truth"
    assert known.surface == "plastic"
    assert known.at_end.truth_gfc > 0.9
    assert known.at_end.power_error_db != known.at_end.held_out_power_error_db
    assert len(known.worst) == 2
    assert known.power_map.power_error_db.shape == (12, 12)
    rms = np.sqrt(np.mean(known.power_map.power_error_db**2))
    assert known.final.plane_power_error_db == pytest.approx(rms)
    assert all(len(each.truth) == each.frequencies_hz[-1] + 1 for each in known.held_out)


def test_without_annotations_the_same_session_is_held_against_itself(known, unknown):
    assert unknown.basis == "held-out"
    assert unknown.worst == ()
    assert unknown.power_map is None
    assert unknown.at_end.gfc == known.at_end.gfc
    assert unknown.at_end.power_error_db == known.at_end.held_out_power_error_db


def test_session_at_rest_has_no_samples_and_its_report_says_why(tmp_path):
    frames = empty_frames(6000)
    frames["sequence"] = np.arange(6000)
    frames["time_ns"] = np.arange(6000) * 1_000_000
    frames["acceleration_m_s2"][:, 2] = 9.81
    evaluation = evaluate_session(RecordedSession(frames), SETTINGS)
    assert evaluation.start_s is None
    assert evaluation.stop_s is None
    assert evaluation.held_out == ()
    assert [step.samples for step in evaluation.steps] == [0, 0]
    assert all(step.gfc is None and step.power_error_db is None for step in evaluation.steps)
    assert evaluation.at_end.distance == pytest.approx(27 * cells_of(2).farthest)
    json.dumps(evaluation.as_dict(), allow_nan=False)
    assert "never stroked" in write_report(tmp_path, [evaluation]).read_text(encoding="utf-8")


def test_hand_that_covers_a_corner_is_told_so(make_session):
    slow = [(30.0 + 2 * n, 0.3 + 0.02 * n) for n in range(14)]
    evaluation = evaluate_session(make_session(slow), SETTINGS)
    assert evaluation.stop_s is None
    coverage = evaluation.coverage
    far = {(round(cell.speed_mm_s), cell.force_n) for cell in coverage.cells if cell.far}
    assert (250, 2.5) in far
    assert (50, 0.5) not in far
    assert coverage.speed_mm_s == pytest.approx((27, 56), abs=5)
    assert coverage.force_n == pytest.approx((0.3, 0.56), abs=0.1)
    assert "(250 mm/s, 2.5 N)" in coverage.remark


def test_gaps_in_the_session_are_counted_and_survived(stroked_session):
    frames = stroked_session.frames
    keep = np.ones(len(frames), dtype=bool)
    keep[3000:3040] = keep[5500:5503] = False
    evaluation = evaluate_session(replace(stroked_session, frames=frames[keep]), SETTINGS)
    assert evaluation.missing_frames == 43
    assert evaluation.faults.missing_s == 0.043
    said = evaluation.faults.sentence()
    assert "frames were missing for 0.043 s" in said
    assert evaluation.as_dict()["faults"]["text"] == said
    assert f" Not measured: {said}." in evaluation.remark
    assert evaluation.duration_s == pytest.approx(len(frames) / 1000)
    assert evaluation.final.gfc > 0.9


def test_a_dead_accelerometer_is_the_reason_and_the_strokes_were_made(stroked_session):
    frames = stroked_session.frames.copy()
    frames["acceleration_m_s2"] = 9.81
    evaluation = evaluate_session(replace(stroked_session, frames=frames), SETTINGS)
    assert evaluation.start_s is None
    assert evaluation.final.samples == 0
    assert "the tool stroked at" in evaluation.remark
    assert "Not measured: the accelerometer gave one value throughout." in evaluation.remark


def test_progress_is_reported_up_to_the_end(stroked_session):
    reached_s = []
    evaluate_session(stroked_session, SETTINGS, on_progress=reached_s.append)
    assert reached_s == sorted(set(reached_s))
    assert reached_s[-1] == len(stroked_session.frames) / 1000.0
    built_s = []
    build_model(stroked_session.frames, SETTINGS, update_s=2.0, on_progress=built_s.append)
    assert built_s[:2] == [2.0, 4.0]
    assert built_s[-1] == reached_s[-1]


def test_blocks_are_those_of_a_live_leader():
    frames = empty_frames(3600)
    frames["sequence"] = np.arange(3600) + 17
    blocks = list(stream_blocks([frames], 1000))
    assert [len(block) for block in blocks] == [1000, 1000, 1000, 600]
    with_gap = np.delete(frames, slice(900, 1100))
    blocks = list(stream_blocks([with_gap], 1000))
    assert sum(map(len, blocks)) == 3400
    assert [int(block["sequence"][0]) - 17 for block in blocks] == [0, 1101, 2101, 3101]
    assert len(blocks[0]) == 901
    frames["sequence"][1500:] = np.arange(2100)  # the follower started anew
    assert sum(map(len, stream_blocks([frames], 1000))) == 3600


@pytest.mark.parametrize("options", [{"step_s": 0.0}, {"step_s": float("nan")}, {"period_s": -1.0}])
def test_unusable_options_and_sessions_are_refused(stroked_session, options):
    with pytest.raises(InputError, match=next(iter(options))):
        evaluate_session(stroked_session, SETTINGS, **options)
    for frames, words in (
        (empty_frames(0), "no frames"),
        (empty_frames(3000, ("position", "force")), "acceleration"),
    ):
        with pytest.raises(InputError, match=words):
            evaluate_session(RecordedSession(frames), SETTINGS)


def test_a_long_recording_has_at_most_forty_rows():
    """A hundred and ten seconds, of which the hand rests in all but ten."""
    frames, _ = simulate_session(Scene(), "plastic", 10.0, 1)
    still = np.zeros(100_000, frames.dtype)
    still["sequence"] = len(frames) + np.arange(len(still))
    still["time_ns"] = still["sequence"].astype(np.int64) * 1_000_000
    still["position_mm"] = frames["position_mm"][-1]
    found = evaluate_session(RecordedSession(np.concatenate([frames, still])))
    assert found.step_s == 5.0
    assert [step.time_s for step in found.steps][:2] == [5.0, 10.0]
    assert len(found.steps) == 22


def test_frames_on_another_surface_are_not_missing_from_a_model():
    scene = scene_from_tables(
        {"link": {}, "simulated": {}, "hand": {}, "texture": {"surfaces": {}}}
    )
    frames, _ = simulate_session(scene, "plastic", 6.0)
    said = [
        {"evidence": None, "at_sample": 2000, "surface": 2},
        {"evidence": None, "at_sample": 4000, "surface": 1},
    ]
    session = RecordedSession(np.delete(frames, slice(1000, 1100)), events=said)
    evaluations, _ = evaluate_surfaces(session, scene)
    assert [each.faults.missing_s for each in evaluations] == [0.1, 0.0]
    assert "Not measured: frames were missing for 0.1 s." in evaluations[0].remark
    assert "Not measured" not in evaluations[1].remark
