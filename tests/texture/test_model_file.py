"""The model file: a loaded model is the saved one, and the page alone is enough to read it."""

import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from random_samples import fitted, strokes_in

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.field.cells import FELT_POWER, FieldCells
from mmt.texture.model.texture_model import TextureModel, load_model
from mmt.texture.space import ANISOTROPIC, ISOTROPIC
from mmt.texture.touch_down.transient import Law, Transient

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "model-file.md"


def make_samples(space, count):
    return fitted(strokes_in(space, count, 1), space, order=6)


@pytest.mark.parametrize("method", ["field", "published"])
@pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC], ids=lambda space: space.name)
def test_a_loaded_model_is_the_saved_one_to_the_bit(space, method):
    model = TextureModel(make_samples(space, 40), method=method)
    again = TextureModel.from_bytes(model.to_bytes())
    assert (again.method, again.space) == (method, space)
    assert again.to_bytes() == model.to_bytes()
    queries = strokes_in(space, 200, 2).T
    for one, other in zip(model.at(*queries), again.at(*queries), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ["oak", "felt"])
def test_the_pages_code_gives_a_published_models_own_values(name, monkeypatch, tmp_path):
    """Where the network's frequencies are valid as they are, and its level within bounds."""
    path = tmp_path / "model.npz"
    model = TextureModel(load_model(name).samples, method="published")
    model.save(path)
    monkeypatch.setattr(sys, "argv", ["read.py", str(path)])
    names = {"print": lambda *values: None}
    for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        assert "mmt" not in block
        exec(compile(block, str(PAGE), "exec"), names)
    assert str(path) not in {file.path for file in psutil.Process().open_files()}
    inputs = strokes_in(model.space, 300, 5)
    points = model.space.normalise(inputs)
    lsf, variance = model.at(*inputs.T)
    plain = names["at"](points)
    own = np.column_stack([model.samples.variance, model.samples.lsf])
    valid = (plain[:, 0] > 0.0) & (plain[:, 0] < own[:, 0].max()) & (points[:, -1] > 0.1)
    valid &= (plain[:, 1:] >= own[:, 1:].min(axis=0)).all(axis=1)
    valid &= (plain[:, 1:] <= own[:, 1:].max(axis=0)).all(axis=1)
    valid &= (np.diff(plain[:, 1:], axis=1) > 0.03).all(axis=1)
    assert valid.mean() > 0.5
    np.testing.assert_allclose(lsf[valid], plain[valid, 1:], atol=1e-8)
    np.testing.assert_allclose(variance[valid], plain[valid, 0], rtol=1e-6)
    np.testing.assert_allclose(names["filter_of"](lsf[0])[1:], lsf_to_ar(lsf[:1])[0], atol=1e-12)


def changed(data, **arrays):
    """Return a file with some of its arrays replaced, None: removed."""
    with np.load(io.BytesIO(data)) as file:
        content = {name: file[name] for name in file.files} | arrays
    buffer = io.BytesIO()
    np.savez(buffer, **{name: array for name, array in content.items() if array is not None})
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("space", "parts", "method"),
    [
        (ISOTROPIC, {"interpolate": "variance", "interpolator": "delaunay"}, "published"),
        (ANISOTROPIC, {"interpolate": "variance", "interpolator": "network"}, "published"),
        (ANISOTROPIC, {"interpolate": "variance", "interpolator": "delaunay"}, "field"),
        (ISOTROPIC, {"interpolate": "power", "interpolator": "rbf"}, "field"),
        (ISOTROPIC, {"interpolate": "power", "interpolator": "delaunay", "level": "any"}, "field"),
    ],
)
@pytest.mark.parametrize("version", [2, 3, 6])
def test_a_file_of_parts_is_read_as_the_method_that_comes_nearest(space, parts, method, version):
    model = TextureModel(make_samples(space, 30), method=method)
    arrays = {name: np.array(value) for name, value in parts.items()}
    arrays |= {"trend_exponents": np.ones(2), "network_kernel": np.array(["linear", "cubic"])}
    older = changed(model.to_bytes(), format_version=version, method=None, **arrays)
    again = TextureModel.from_bytes(older)
    assert again.method == method
    assert again.to_bytes() == model.to_bytes()


def test_blocks_of_a_file_are_used_with_smoothed_spectra_alone():
    samples = make_samples(ISOTROPIC, 30)
    cells = FieldCells.from_blocks(samples.points, samples.power, np.arange(30))
    data = TextureModel(samples, field=cells).to_bytes()
    parts = {"interpolate": np.array("power"), "interpolator": np.array("delaunay")}
    for shape, used in (("smoothed", True), ("measured", False)):
        older = changed(data, format_version=6, method=None, shape=np.array(shape), **parts)
        assert (TextureModel.from_bytes(older).field is not None) == used


def test_a_model_of_version_1_is_read():
    samples = make_samples(ISOTROPIC, 3)
    model = TextureModel(samples, method="published")
    parts = {"method": None, "inputs": None, "interpolate": np.array("variance")}
    older = changed(model.to_bytes(), format_version=1, **parts)
    assert TextureModel.from_bytes(older).to_bytes() == model.to_bytes()


def filed():
    """A model with all that a file can hold."""
    count = np.full(12, 400.0)
    samples = replace(
        make_samples(ISOTROPIC, 12), effective=count, counts=2 * count, noise_power=0.01
    )
    keys = np.column_stack([np.arange(1, 7), np.arange(1, 7), np.zeros(6), np.zeros(6)])
    cells = FieldCells(False, keys.astype(np.int64), np.array([[4.0, 4.0, 0.0, 0.1]] * 6), 2)
    transient = Transient(np.array([50.0]), np.ones((1, 20)), Law(1.0, 0.5, 50.0, 80.0, 1.0))
    return TextureModel(samples, field=cells, touch_down=transient).to_bytes()


def test_a_model_with_all_that_a_file_can_hold_comes_back():
    model = TextureModel.from_bytes(filed())
    assert model.to_bytes() == filed()
    samples = model.samples
    assert samples.effective is not None
    assert samples.counts is not None
    assert (set(samples.effective), set(samples.counts)) == ({400.0}, {800.0})
    assert (samples.noise_power, model.field.moment_blocks) == (0.01, 2)


def test_blocks_of_version_6_are_gathered_by_place_and_raised_by_what_is_felt():
    log, felt = np.log(2.0), 2.0 + FELT_POWER
    parts = {"interpolate": "power", "interpolator": "delaunay", "shape": "smoothed"}
    older = {
        **{name: np.array(value) for name, value in parts.items()},
        "field_cells": np.pad(NUMBERS["field_cells"][:, :3], ((0, 0), (0, 2))),
        "field_sums": np.array([[4.0, 8.0, 4.0 * log, 4.0 * log**2]] * 6),
    }
    data = changed(filed(), format_version=6, method=None, field_moment_blocks=None, **older)
    field = TextureModel.from_bytes(data).field
    assert (field.moment_blocks, field.keys[:, 3].tolist()) == (1, list(range(6)))
    np.testing.assert_array_equal(field.keys[:, :3], NUMBERS["field_cells"][:, :3])
    raised = [4.0, 4.0 * felt, 4.0 * np.log(felt), 4.0 * np.log(felt) ** 2]
    np.testing.assert_allclose(field.sums, [raised] * 6)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"field_cells": np.zeros((6, 3))}, r"\(6, 3\) and field_sums \(6, 4\): \(r, 4\) and"),
        ({"field_sums": np.ones((5, 4))}, r"field_sums \(5, 4\)"),
        ({"field_cells": np.zeros((0, 4)), "field_sums": np.ones((0, 4))}, r"\(0, 4\)"),
        ({"field_cells": np.full((6, 4), 2.0**31)}, "field_cells must be whole numbers"),
        ({"field_sums": np.array([[4.0, 4.1e12, 0.0, 0.1]] * 6)}, r"mean power above 1e\+12"),
        ({"touch_down_law": np.ones(4)}, r"touch_down_law has shape \(4,\): \(5,\)"),
        ({"touch_down_speed_mm_s": None}, "the array 'touch_down_speed_mm_s' is missing"),
        ({"format_version": None}, "not a texture model: the array 'format_version' is missing"),
        *(({"format_version": v}, f"version is {v}, this mmt reads 1 to 7: upd") for v in (0, 8)),
        ({"format_version": 3}, "'interpolate' is missing"),
        ({"method": None}, "'method' is missing"),
        ({"rate_hz": np.array(-5.0)}, "rate_hz is -5.0, allowed is a finite number at least 1"),
        *(({name: np.full(12, 1.1e12)}, f"^{name} must be") for name in ("power", "variance")),
        ({"inputs": np.array("none")}, "^name is 'none', allowed is"),
        ({"method": np.array("best")}, "method is 'best', allowed are field, published"),
    ],
)
def test_what_does_not_fit_in_a_file_is_explained(arrays, message):
    with pytest.raises(InputError, match=message):
        TextureModel.from_bytes(changed(filed(), **arrays))


with np.load(io.BytesIO(filed())) as _file:
    NUMBERS = {name: _file[name] for name in _file.files if _file[name].dtype.kind in "fi"}


@pytest.mark.parametrize("name", NUMBERS)
def test_an_array_of_another_kind_or_shape_is_refused(name):
    array = NUMBERS[name]
    for other in (array.astype(complex), array.astype(str), array > 0):
        with pytest.raises(InputError, match=f"({name}|lsf) is of .*: real numbers are needed"):
            TextureModel.from_bytes(changed(filed(), **{name: other}))
    with pytest.raises(InputError, match="shape"):
        TextureModel.from_bytes(changed(filed(), **{name: array[np.newaxis]}))


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_that_is_none_is_refused_and_single_precision_is_read(name):
    array = NUMBERS[name].astype(np.float64)
    for value in (np.nan, np.inf, -np.inf):
        wrong = array.copy()
        wrong[(0,) * array.ndim] = value
        with pytest.raises(InputError, match=f"{name.partition('_')[0]}|version|counts"):
            TextureModel.from_bytes(changed(filed(), **{name: wrong}))
    single = TextureModel.from_bytes(changed(filed(), **{name: array.astype(np.float32)}))
    whole = TextureModel.from_bytes(filed())
    np.testing.assert_allclose(single.vertices, whole.vertices, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("name", ["format_version", "field_cells", "field_moment_blocks"])
def test_a_fraction_of_what_is_counted_is_refused(name):
    wrong = NUMBERS[name] + 0.5
    with pytest.raises(InputError, match=r"must be whole numbers|version is 7\.5"):
        TextureModel.from_bytes(changed(filed(), **{name: wrong}))
