"""The model file: a loaded model is the saved one, and the page alone is enough to read it."""

import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

from mmt.core.errors import InputError
from mmt.models import find_model
from mmt.texture.autoregression.forms import lsf_to_ar, output_power, reflection_to_lsf
from mmt.texture.autoregression.lsf import lsf_inverse_gain
from mmt.texture.model.file import FittedParameters
from mmt.texture.model.inputs import ANISOTROPIC, ISOTROPIC
from mmt.texture.model.samples import TextureSamples
from mmt.texture.model.texture_model import TextureModel

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "model-file.md"


def inputs_of(space, count: int, seed: int) -> np.ndarray:
    """Return inputs (count, d) inside the space, none of them at rest."""
    generator = np.random.default_rng(seed)
    speed, heading = generator.uniform(20, 290, count), generator.uniform(-np.pi, np.pi, count)
    return space.from_motion(
        speed * np.cos(heading), speed * np.sin(heading), generator.uniform(0.1, 2.9, count)
    )


def make_samples(space, count: int, order: int = 6) -> TextureSamples:
    generator = np.random.default_rng(3)
    reflection = generator.uniform(-0.8, 0.8, (count, order))
    variance = generator.uniform(0.5, 2.0, count)
    power = output_power(variance, reflection)
    lsf = reflection_to_lsf(reflection)
    return TextureSamples(inputs_of(space, count, 1), lsf, variance, power, space)


def assert_alike(one: FittedParameters, other: FittedParameters) -> None:
    assert one.trend == other.trend
    assert one.interpolator_state.keys() == other.interpolator_state.keys()
    for name, array in one.interpolator_state.items():
        np.testing.assert_array_equal(array, other.interpolator_state[name])


def grown(space, interpolator: str) -> TextureModel:
    """Return a model that has grown, whose settings are of fewer samples than it has."""
    samples = make_samples(space, 70)
    model = None
    for count in (40, 48, 56, 64, 70):
        first = TextureSamples(
            *(getattr(samples, name)[:count] for name in ("inputs", "lsf", "variance", "power")),
            space,
        )
        model = TextureModel(first, interpolator=interpolator, previous=model)  # type: ignore[arg-type]
    assert model is not None
    return model


@pytest.mark.parametrize("interpolate", ["variance", "power", "amplitude"])
@pytest.mark.parametrize("interpolator", ["delaunay", "nearest", "rbf", "network"])
@pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC], ids=lambda space: space.name)
def test_a_loaded_model_is_the_saved_one_to_the_bit(space, interpolator, interpolate) -> None:
    samples = make_samples(space, 40)
    model = TextureModel(samples, interpolator=interpolator, interpolate=interpolate)
    again = TextureModel.from_bytes(model.to_bytes())
    assert_alike(again.fitted, model.fitted)
    assert again.to_bytes() == model.to_bytes()
    queries = inputs_of(space, 200, 2).T
    for one, other in zip(model.at(*queries), again.at(*queries), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC], ids=lambda space: space.name)
def test_a_model_that_grew_keeps_its_settings(space) -> None:
    model = grown(space, "rbf")
    again = TextureModel.from_bytes(model.to_bytes())
    assert_alike(again.fitted, model.fitted)
    with pytest.raises(AssertionError):
        assert_alike(again.fitted, TextureModel(model.samples, interpolator="rbf").fitted)
    queries = inputs_of(space, 200, 2).T
    for one, other in zip(model.at(*queries), again.at(*queries), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)


@pytest.mark.parametrize("name", ["oak", "felt"])
def test_the_pages_code_gives_the_models_own_values(name, monkeypatch) -> None:
    """Where the network's frequencies are valid as they are, and its level within bounds."""
    path = find_model(Path(name))
    monkeypatch.setattr(sys, "argv", ["read.py", str(path)])
    names: dict[str, object] = {"print": lambda *values: None}
    for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        assert "mmt" not in block
        exec(compile(block, str(PAGE), "exec"), names)
    assert str(path) not in {file.path for file in psutil.Process().open_files()}
    model = TextureModel.load(path)
    inputs = inputs_of(model.space, 300, 5)
    points = model.space.normalise(inputs)
    lsf, variance = model.at(*inputs.T)

    plain = names["lsf_at"](points)
    free = (plain > model.samples.lsf.min(axis=0)) & (plain < model.samples.lsf.max(axis=0))
    valid = free.all(axis=1) & (np.diff(plain, axis=1) > 0.03).all(axis=1)
    assert valid.mean() > 0.5
    np.testing.assert_allclose(lsf[valid], plain[valid], atol=1e-8)

    level = names["level_at"](points)
    if model.space.directed:
        level = level * names["law"](points)
    work = np.empty(256)
    expected = [power * lsf_inverse_gain(row, work) for power, row in zip(level, lsf, strict=True)]
    inside = (points[:, -1] > 0.2) & (level > 0)
    np.testing.assert_allclose(variance[inside], np.array(expected)[inside], rtol=1e-6)
    np.testing.assert_allclose(names["filter_of"](lsf[0])[1:], lsf_to_ar(lsf[:1])[0], atol=1e-12)


def changed(data: bytes, **arrays) -> bytes:
    """Return a file with some of its arrays replaced, None: removed."""
    with np.load(io.BytesIO(data)) as file:
        content = {name: file[name] for name in file.files} | arrays
    buffer = io.BytesIO()
    np.savez(buffer, **{name: array for name, array in content.items() if array is not None})
    return buffer.getvalue()


def test_a_model_of_version_2_is_fitted_anew() -> None:
    model = TextureModel(make_samples(ANISOTROPIC, 30), interpolator="rbf")
    names = ("kernel", "degree", "epsilon", "smoothing")
    older = changed(
        model.to_bytes(),
        format_version=2,
        trend_exponents=None,
        **{f"network_{name}": None for name in names},
    )
    assert_alike(TextureModel.from_bytes(older).fitted, model.fitted)


def test_a_level_of_versions_4_and_5_is_that_of_its_samples() -> None:
    plain = make_samples(ANISOTROPIC, 12)
    samples = replace(plain, effective=np.full(12, 60.0), counts=np.full(12, 200.0))
    model = TextureModel(samples, level="gaussian_process")
    found = TextureModel.from_bytes(model.to_bytes())
    np.testing.assert_array_equal(found.samples.counts, samples.counts)
    for version in (4, 5):
        older = changed(
            model.to_bytes(), format_version=version, level_hyperparameters=np.zeros(10)
        )
        again = TextureModel.from_bytes(older)
        np.testing.assert_array_equal(again.kernel_parameters, model.kernel_parameters)


def test_counts_that_are_none_are_refused() -> None:
    samples = replace(make_samples(ISOTROPIC, 5), counts=np.array([100.0, 0.0, 3.0, 4.0, 5.0]))
    with pytest.raises(InputError, match="counts must be positive"):
        TextureModel(samples)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"trend_exponents": None}, "'trend_exponents' is missing"),
        ({"trend_exponents": np.array([1.0])}, "do not fit together"),
        ({"trend_exponents": np.array([np.nan, 0.7])}, "exponents"),
        ({"trend_exponents": np.array([1.0, 1e9])}, "exponents"),
        ({"trend_exponents": np.array(["a", "b"])}, "do not fit together"),
        ({"network_kernel": None}, "'network_kernel' is missing"),
        ({"network_kernel": np.array(["linear", "bump"])}, "kernel is 'bump'"),
        ({"network_kernel": np.array("linear")}, "not two"),
        ({"network_degree": np.array([1, -3])}, "degree is -3"),
        ({"network_degree": np.array([0.5, 0.5])}, "no integers"),
        ({"network_epsilon": np.array([1.0, np.nan])}, "epsilon is nan"),
        ({"network_smoothing": np.array([-1.0, 0.0])}, "smoothing is -1"),
        ({"network_smoothing": np.array([0.0])}, "not two"),
        ({f"network_{n}": np.zeros(0) for n in ("degree", "epsilon", "smoothing")}, "not two"),
    ],
)
def test_what_cannot_have_been_fitted_is_explained(arrays, message) -> None:
    data = TextureModel(make_samples(ANISOTROPIC, 30), interpolator="rbf").to_bytes()
    with pytest.raises(InputError, match=message):
        TextureModel.from_bytes(changed(data, **arrays))
