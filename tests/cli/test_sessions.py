"""``mmt session``: several trials at once, and what was no measurement."""

import numpy as np
from command_runs import output_of, run_json

from mmt.session.files import read_session, write_session
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations


def simulate(*options):
    output_of("session", "simulate", *options, "--duration", 0.5, "--surface", "oak")


def test_trials_are_numbered_sessions_of_seeds_in_a_row(tmp_path):
    simulate(tmp_path / "oak.mcap", "--trials", 10, "--seed", 5)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"oak-{number:02}.mcap" for number in range(1, 11)]
    simulate(tmp_path / "single.mcap", "--seed", 7)
    single = read_session(tmp_path / "single.mcap")
    trials = [read_session(tmp_path / name) for name in names[1:3]]
    np.testing.assert_array_equal(trials[1].frames, single.frames)
    assert (trials[0].frames["acceleration_m_s2"] != single.frames["acceleration_m_s2"]).any()
    assert surface_from_annotations(single.annotations).name == "oak"


def test_info_says_that_the_accelerometer_was_dead(tmp_path):
    simulate(tmp_path / "oak.mcap")
    frames = read_session(tmp_path / "oak.mcap").frames.copy()
    found, result = run_json(tmp_path, "session", "info", tmp_path / "oak.mcap")
    assert "not measured" not in result.output
    assert found["faults"]["text"] == ""
    frames["acceleration_m_s2"] = 9.81
    frames["position_mm"][:, 0] = 0.1 * frames["sequence"]
    frames["force_n"][:, 2] = 1.0
    write_session(tmp_path / "dead.mcap", frames)
    said = "the accelerometer gave one value throughout"
    found, result = run_json(tmp_path, "session", "info", tmp_path / "dead.mcap")
    assert f"not measured: {said}" in result.output
    assert found["faults"]["text"] == said
    # what waits for its motion has not left the filter
    assert 0.4 < found["faults"]["constant_s"] <= 0.5
