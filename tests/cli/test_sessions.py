"""``mmt session``: several trials at once, and what was no measurement."""

import json

import numpy as np
from typer.testing import CliRunner

from mmt.cli.main import app
from mmt.session import read_session, write_session
from mmt.testing.simulation.known_surfaces import surface_from_annotations


def simulate(*options):
    arguments = ["session", "simulate", *map(str, options), "--duration", "0.5"]
    result = CliRunner().invoke(app, [*arguments, "--surface", "oak"])
    assert result.exit_code == 0, result.output


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
    assert "not measured" not in info_of(tmp_path / "oak.mcap", tmp_path / "oak.json")
    assert json.loads((tmp_path / "oak.json").read_text())["faults"]["text"] == ""
    frames["acceleration_m_s2"] = 9.81
    frames["position_mm"][:, 0] = 0.1 * frames["sequence"]
    frames["force_n"][:, 2] = 1.0
    write_session(tmp_path / "dead.mcap", frames)
    said = "the accelerometer gave one value throughout"
    assert f"not measured: {said}" in info_of(tmp_path / "dead.mcap", tmp_path / "dead.json")
    faults = json.loads((tmp_path / "dead.json").read_text())["faults"]
    assert faults["text"] == said
    assert 0.4 < faults["constant_s"] <= 0.5  # what waits for its motion has not left the filter


def info_of(path, json_file):
    result = CliRunner().invoke(app, ["session", "info", str(path), "--json", str(json_file)])
    assert result.exit_code == 0, result.output
    return result.output
