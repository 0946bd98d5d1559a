"""What the hand feels over a network is judged against the surface under the hand."""

from dataclasses import replace

import numpy as np
import pytest
from lab_runs import run_lab

from mmt.scene import Network
from mmt.testing.simulation.surfaces.textures import SURFACES
from mmt_lab.experiments import felt
from mmt_lab.experiments.felt import run_trial
from mmt_lab.felt.judging import Reference
from mmt_lab.felt.passing import (
    NEVER_TICK,
    leader_vibration,
    local_models,
    stroke_over_network,
    undelayed_vibration,
)

PLASTIC = SURFACES["plastic"]


@pytest.fixture(scope="module")
def far():
    """Six seconds over 50 ms each way."""
    return stroke_over_network(PLASTIC, Network(delay_ms=50.0), 6000, 4)


@pytest.fixture(scope="module")
def own(far):
    return undelayed_vibration(far, 1)


@pytest.fixture(scope="module")
def reference(far, own):
    return Reference(far, own)


def test_a_delay_counts_both_ways(far):
    assert set((far.arrival_tick - np.arange(6000)).tolist()) == {50}
    near = stroke_over_network(PLASTIC, Network(), 6000, 4)
    np.testing.assert_array_equal(near.force_n, far.force_n)  # the same hand
    later = np.argmax(far.frames["force_n"][:, 2] > 0.2)
    assert later - np.argmax(near.frames["force_n"][:, 2] > 0.2) == pytest.approx(50, abs=3)


def test_lost_frames_never_arrive_and_others_do():
    passage = stroke_over_network(PLASTIC, Network(loss=0.3), 1000, 1)
    lost = passage.arrival_tick == NEVER_TICK
    assert 0.15 < lost.mean() < 0.45
    assert (passage.arrival_tick[~lost] == np.flatnonzero(~lost)).all()


def test_the_texture_itself_has_no_bias_and_no_delay(far, reference):
    other = reference.judge(undelayed_vibration(far, 2))
    # the mean of a logarithm is below the logarithm of the mean, by a quarter dB here
    assert abs(other.level_db.mean()) < 0.7
    assert np.sqrt(np.mean(np.square(other.level_db))) < 1.5
    assert len(other.onset_ms)
    assert np.abs(np.median(other.onset_ms)) < 20


def test_a_gain_is_found_as_a_level_in_every_band(own, reference):
    once, twice = reference.judge(own), reference.judge(2.0 * own)
    loud = np.isin(twice.time_s, once.time_s)
    assert np.median(twice.level_db[loud] - once.level_db) == pytest.approx(6.02, abs=0.05)


@pytest.mark.parametrize(("tone_hz", "lost_db"), [(20.0, 26.1), (90.0, 3.0), (300.0, 0.0)])
def test_what_the_actuator_does_not_play_is_lost_at_the_skin(far, tone_hz, lost_db):
    tone = 30.0 * np.sin(2e-3 * np.pi * tone_hz * np.arange(6000))
    found = Reference(far, tone).judge(tone)
    lost = np.median(found.level_db - found.skin_db)
    assert lost == pytest.approx(lost_db, abs=0.5)


def test_a_shift_is_found_as_onset_and_offset(own, reference):
    found = reference.judge(np.concatenate([np.zeros(80), own[:-80]]))
    assert np.median(found.onset_ms) == pytest.approx(80, abs=1)
    assert np.median(found.offset_ms) == pytest.approx(80, abs=1)


def test_a_stream_is_as_late_as_both_ways_and_a_model_is_not(far, reference):
    streamed, never_s = leader_vibration(far, None, 1)
    assert never_s is None
    late = reference.judge(streamed)
    assert np.median(late.onset_ms) == pytest.approx(110, abs=25)
    models = local_models(far, {"method": "published", "start_distance": 100.0})
    modelled, start_s = leader_vibration(far, models, 1)
    assert start_s < 5.0
    errors = [
        np.sqrt(np.mean(np.square(c.level_db[c.time_s > start_s + 0.2])))
        for c in (reference.judge(modelled), late)
    ]
    assert errors[0] < 0.7 * errors[1]


def test_headings_are_unit_vectors_even_at_rest(far):
    velocity_mm_s = np.array([[3.0, 4.0], [0.0, 0.0], [0.0, -1e-300], [1e150, 0.0]])
    unit = replace(far, velocity_mm_s=velocity_mm_s).heading
    np.testing.assert_allclose(unit, [[0.6, 0.8], [1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])


def test_the_command_prints_every_method_and_writes_a_report(monkeypatch, tmp_path):
    monkeypatch.setattr("mmt_lab.experiments.felt.DURATION_S", 2.0)
    outcomes = run_trial("fabric", "wan", 5)
    monkeypatch.setattr(felt, "map_in_processes", lambda *_, **__: [outcomes])
    options = ("--textures", "fabric", "--seeds", "1", "--report", str(tmp_path / "report"))
    written, output = run_lab(tmp_path, "felt", *options)
    names = ("streaming", "published", "field", "at once")
    assert all(name in output for name in names)
    assert len(written["rows"]) == 4
    assert set(written["level_db_by_second"]["wan"]) == set(names)
    assert "data:image/png" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
