"""The shipped models: what they are, that they can be built anew, and found by name."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_runs import run_json

from mmt.core.errors import InputError
from mmt.models import find_model, shipped_models
from mmt.rendering import close, open_textures, render, touch
from mmt.testing.simulation.surfaces.textures import GRAINED, get_surface
from mmt.texture.model.texture_model import TextureModel
from mmt_lab.shipped_models import build, measure, settings_of, trials_of

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "shipped-models.md"
ISOTROPIC = {surface.name: surface.isotropic for surface in GRAINED}
LARGEST_BYTES = 70_000


def table():
    """Return the page's cells by the model's name."""
    text = PAGE.read_text(encoding="utf-8").partition("models: begin")[2]
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| `")]
    return {cells[0].strip("`"): cells[1:] for cells in lines}


def test_there_is_one_for_each_of_the_nine_textures():
    assert set(shipped_models()) == set(table()) == set(ISOTROPIC)
    assert all(path.stat().st_size <= LARGEST_BYTES for path in shipped_models().values())


@pytest.mark.parametrize("name", ["felt", "corduroy"])
def test_model_is_as_good_as_the_page_says(name):
    model = TextureModel.load(find_model(Path(name)))
    cells = table()[name]
    assert model.space.directed != ISOTROPIC[name]
    assert cells[:2] == [model.space.name, f"{len(model.samples)}, {model.order}"]
    errors = measure(name, model)
    assert cells[3:6] == [
        f"{errors.gfc:.3f}",
        f"{errors.log_spectral_db:.1f} dB",
        f"{errors.power_error_db:.2f} dB",
    ]
    if not ISOTROPIC[name]:
        without = [float(number) for number in re.findall(r"[\d.]+", cells[7])]
        assert errors.gfc > without[0]
        assert errors.log_spectral_db < without[1]
        assert errors.power_error_db < without[2]


def test_a_model_is_built_anew_as_it_is_shipped():
    surface = get_surface("felt")
    shipped = TextureModel.load(find_model(Path("felt")))
    built = build(trials_of(surface), settings_of(surface))
    assert (built.order, built.rate_hz, built.space) == (shipped.order, 1000.0, shipped.space)
    for name in ("inputs", "lsf", "variance", "power"):
        np.testing.assert_allclose(
            getattr(built.samples, name), getattr(shipped.samples, name), rtol=1e-6
        )


def test_a_name_is_found_and_a_file_of_that_name_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_model(Path("oak")) == shipped_models()["oak"]
    assert find_model(Path("none/oak")) == Path("none/oak")
    assert find_model(Path("oak.npz")) == Path("oak.npz")
    (tmp_path / "oak").write_bytes(b"")
    assert find_model(Path("oak")) == Path("oak")
    with pytest.raises(InputError, match="model elm: no such file; shipped are brushed-plastic, "):
        find_model(Path("elm"))


def test_the_command_line_knows_the_names(tmp_path):
    listed, result = run_json(tmp_path, "model", "list")
    assert set(listed) == set(ISOTROPIC)
    assert listed["felt"]["inputs"] == "isotropic"
    for name, figures in listed.items():
        row = r"[^\w\n]+".join([name, *map(str, figures.values())])
        assert re.search(row, result.output), "one row a model"
    told, _ = run_json(tmp_path, "model", "info", "oak")
    assert told["samples"] == listed["oak"]["samples"]


def test_the_library_renders_them_by_name_and_hears_the_heading():
    textures = open_textures(["ridged-plastic"], output_hz=1000.0, seed=3)
    power = {}
    for heading, velocity in (("across", (150.0, 0.0)), ("along", (0.0, 150.0))):
        touch(textures, 0, *velocity, force_n=1.5)
        power[heading] = float(np.mean(np.square(render(textures, 6000)[1000:])))
    close(textures)
    assert power["across"] > 3.0 * power["along"]
