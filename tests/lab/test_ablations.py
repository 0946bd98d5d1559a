"""Ingredients of the field are left out, each alone, and put back."""

import numpy as np
import pytest
from lab_runs import run_lab

from mmt.texture.online.history import build
from mmt.texture.settings import ModellingSettings
from mmt_lab.compare import ablations
from mmt_lab.compare.ablations import INGREDIENTS, Ingredient, without
from mmt_lab.compare.cases import ComparisonCase
from mmt_lab.compare.judging import blocks_of

HEADINGS = {"ridges", "nap"}
"""Ingredients of models over velocity and force alone."""


def rendered(case, blocks):
    model = build(blocks, ModellingSettings(inputs=case.inputs)).model_at(10.0)
    speeds, forces = (axis.ravel() for axis in np.meshgrid([11, 90, 200, 280], [0.11, 1.0, 2.5]))
    density = model.spectrum(speeds, forces, frequencies_hz=np.arange(8.0, 500.0, 4.0))
    return np.concatenate([density.ravel(), model.level_db(speeds, forces)[1]])


@pytest.mark.parametrize(
    ("texture", "names"), [("glass", set(INGREDIENTS) - HEADINGS), ("corduroy", HEADINGS)]
)
def test_each_ingredient_changes_the_model_and_comes_back(texture, names):
    case = ComparisonCase(texture, 3)
    blocks = blocks_of(case.session())[:10]
    whole = rendered(case, blocks)
    for name in sorted(names):
        with without(name):
            less = rendered(case, blocks)
        assert np.isfinite(less).all(), name
        assert not np.allclose(less, whole, rtol=1e-9), name
    np.testing.assert_array_equal(rendered(case, blocks), whole)


def test_what_is_no_longer_there_cannot_be_left_out(monkeypatch):
    gone = Ingredient("gone", "mmt.texture.field.posterior:no_such_thing", lambda old: old)
    monkeypatch.setattr(ablations, "INGREDIENTS", {"gone": gone})
    with pytest.raises(AttributeError, match="no_such_thing"), without("gone"):
        pass


def test_the_experiment_says_what_an_ingredient_costs(tmp_path, monkeypatch):
    monkeypatch.setattr("mmt_lab.harness.experiment.DRAWN", 1)
    monkeypatch.setattr("mmt_lab.experiments.ablations.INHOMOGENEOUS", ("plastic+patches",))
    options = ("--textures", "glass", "--ingredients", "smoothing", "--spoil", "knock")
    tables = run_lab(tmp_path, "ablations", *options, "--workers", "1")[0]["tables"]
    names = [table["caption"].split(",")[0].split(":")[0] for table in tables]
    assert names == [name for name in ("clean", "noisy", "drawn", "uneven", "spoilt") for _ in "12"]
    for table in tables:
        assert [row[0] for row in table["rows"]] == ["whole field", "smoothing"]
    worse = float(tables[3]["rows"][1][3])  # the spectrum at 30 s
    assert worse > 0.0
