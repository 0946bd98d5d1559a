"""`mmt model select`: trials and models, from files to a thinner model."""

import json
from functools import partial

import numpy as np
import pytest
from command_runs import run
from library_samples import directed

from mmt.core.errors import InputError
from mmt.evaluation.truth import known_texture
from mmt.scene import Scene
from mmt.session.files import read_session, write_session
from mmt.testing.simulation.offline import simulate_session
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.settings import ModellingSettings
from mmt_methods.selection import select
from mmt_methods.selection.command import selection_plane
from mmt_methods.selection.pooling import pool_models

KNOCK_AT = (4150, 9150)  # well inside of segments


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    """Two trials on plastic; on the first somebody knocks twice."""
    folder = tmp_path_factory.mktemp("trials")
    paths = []
    for seed in (1, 2):
        frames, annotations = simulate_session(Scene(), "plastic", 12.0, seed)
        if seed == 1:
            decay = np.exp(-np.arange(80) / 15.0) * np.sin(np.arange(80))
            for start in KNOCK_AT:
                frames["acceleration_m_s2"][start : start + 80, 2] += 20.0 * decay
        paths.append(folder / f"trial{seed}.npz")
        write_session(paths[-1], frames, annotations=annotations)
    return paths


select_command = partial(run, "model", "select")


def test_trials_become_a_thinner_model_without_the_knocks(trials, tmp_path):
    result = select_command(
        *trials,
        *("--output", tmp_path / "thin.npz", "--plot", tmp_path / "plane.png"),
        *("--json", tmp_path / "s.json"),
    )
    assert result.exit_code == 0, result.output
    figures = json.loads((tmp_path / "s.json").read_text())
    assert figures["count"] == figures["kept"] + figures["redundant"] + figures["outliers"]
    outliers = [row for row in figures["samples"] if row["kind"] == "outlier"]
    assert len([row for row in outliers if row["source"] == str(trials[0])]) >= 2
    assert all(row["reason"] for row in outliers)
    assert "outlier at" in result.output
    assert "before: spectral error" in result.output
    model = TextureModel.load(tmp_path / "thin.npz")
    assert len(model.samples) == figures["kept"] < figures["count"]
    truth, _ = known_texture(read_session(trials[0]).annotations, ModellingSettings())
    lowest_db = truth.plane.errors(model).bands_db[:, 0].mean()  # not those behind the high-pass
    assert abs(lowest_db) < 1.0
    assert (tmp_path / "plane.png").read_bytes().startswith(b"\x89PNG")


def test_models_are_pooled_and_the_published_algorithm_can_be_asked(trials, tmp_path):
    whole = tmp_path / "whole.npz"
    assert select_command(*trials, "--tau", 0, "--output", whole).exit_code == 0
    twice = tmp_path / "twice.npz"
    result = select_command(whole, whole, "--json", tmp_path / "m.json", "--output", twice)
    assert result.exit_code == 0, result.output
    one, both = (TextureModel.load(path).samples for path in (whole, twice))
    assert both.noise_power == one.noise_power > 0.0
    assert "a model has no segments" in result.output
    assert json.loads((tmp_path / "m.json").read_text())["compression"] >= 2.0
    published = select_command(*trials, "--method", "published", "--json", tmp_path / "p.json")
    assert published.exit_code == 0, published.output
    assert "spectral error" in published.output


def test_a_scene_that_models_as_published_selects_as_published(trials, tmp_path):
    scene = tmp_path / "published.toml"
    scene.write_text('[link]\n[simulated]\n[hand]\n[texture]\nmethod = "published"\n')
    by_scene = select_command(*trials, "--scene", scene, "--json", tmp_path / "scene.json")
    asked = select_command(*trials, "--method", "published", "--json", tmp_path / "asked.json")
    assert (by_scene.exit_code, asked.exit_code) == (0, 0), by_scene.output
    first, other = (json.loads((tmp_path / f).read_text()) for f in ("scene.json", "asked.json"))
    assert first["samples"] == other["samples"]
    ours = select_command(*trials, "--scene", scene, "--method", "ours")
    assert "its spectral error" not in ours.output


def test_a_model_whose_heading_counts_is_drawn_in_two_planes():
    pool = pool_models([directed(0), directed(1)], ["a", "b"])
    figure = selection_plane(pool.samples, select(pool.data))
    assert len(figure.axes) == 2
    assert pool.model(np.arange(24) < 12).space.directed


def test_what_cannot_be_selected_from_is_refused(trials, tmp_path):
    whole = tmp_path / "whole.npz"
    assert select_command(*trials, "--output", whole).exit_code == 0
    for arguments, words in (
        ((whole, trials[0]), "one kind"),
        ((trials[0], "--output", tmp_path / "x.txt"), "must end in"),
        ((tmp_path / "absent.npz",), "absent"),
        ((whole, "--scene", "demo"), "--scene"),
    ):
        result = select_command(*arguments)
        assert isinstance(result.exception, InputError)
        assert words in str(result.exception)
