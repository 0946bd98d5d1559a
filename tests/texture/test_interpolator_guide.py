"""The how-to on interpolators: its module, as it stands on the page, is a whole interpolator."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.models import find_model
from mmt.scene.files import scene_from_tables
from mmt.texture.interpolation import registry
from mmt.texture.model.file import unpack
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.synthesis.synthesizer import Synthesizer

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "add-an-interpolator.md"
NAME = "inverse-distance"


@pytest.fixture
def registered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, line = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    package = tmp_path / "my_package"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "inverse_distance.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "INTERPOLATORS", dict(registry.INTERPOLATORS))
    exec(compile(line, str(PAGE), "exec"), {})


def samples_of(name: str) -> TextureSamples:
    return TextureModel.load(find_model(Path(name))).samples


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("name", ["felt", "oak"])
def test_the_pages_interpolator_renders_and_comes_back_from_its_file(name: str) -> None:
    samples = samples_of(name)
    model = TextureModel(samples, interpolator=NAME)
    inputs = [np.full(500, 60.0)] * (model.dimensions - 1) + [np.full(500, 1.0)]
    lsf, variance = model.at(*samples.inputs.T)
    np.testing.assert_allclose(lsf, samples.lsf, atol=0.05)
    assert (np.diff(lsf, prepend=0.0, append=np.pi) > 0).all()
    assert (variance >= 0).all()
    assert Synthesizer(model, seed=1).render(*inputs).std() > 0

    again = TextureModel.from_bytes(model.to_bytes())
    assert "inverse_distance_exponent" in unpack(model.to_bytes()).fitted.interpolator_state
    assert again.to_bytes() == model.to_bytes()
    for one, other in zip(again.at(*inputs), model.at(*inputs), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.usefixtures("registered")
def test_the_pages_interpolator_is_a_name_in_a_scene() -> None:
    tables = {"link": {}, "simulated": {}, "hand": {}, "texture": {"interpolator": NAME}}
    scene = scene_from_tables(tables)
    assert scene.texture is not None
    assert scene.texture.settings(1000.0).interpolator == NAME


def test_a_name_that_is_not_registered_is_refused_with_those_that_are() -> None:
    with pytest.raises(InputError, match="allowed are delaunay, nearest, network, rbf"):
        TextureModel(samples_of("oak"), interpolator="spline")
    tables = {"link": {}, "simulated": {}, "hand": {}, "texture": {"interpolator": "spline"}}
    with pytest.raises(InputError, match="'spline', allowed are delaunay, nearest, network, rbf"):
        scene_from_tables(tables)


@pytest.mark.parametrize("interpolator", ["delaunay", "nearest", "rbf"])
def test_an_interpolant_is_pickled_without_its_address(interpolator: str) -> None:
    interpolant = TextureModel(samples_of("felt"), interpolator=interpolator).interpolant
    again = pickle.loads(pickle.dumps(interpolant.evaluator))
    assert again is interpolant.evaluator


def test_a_state_with_a_name_of_the_models_own_is_refused(monkeypatch) -> None:
    model = TextureModel(samples_of("felt"), interpolator="delaunay")
    monkeypatch.setattr(type(model.interpolant), "state", lambda _: {"power": np.zeros(1)})
    with pytest.raises(ValueError, match=r"\['power'\]"):
        model.to_bytes()
