"""What a model is made of, and what it tells of itself."""

import pickle

import numpy as np
import pytest
from random_samples import fitted, strokes_in

from mmt.core.errors import InputError
from mmt.texture.field.shape_smoothing import smoothed_shapes
from mmt.texture.interpolation.vertices import vertex_table
from mmt.texture.model.texture_model import TextureModel, TextureSamples, load_model
from mmt.texture.space import ANISOTROPIC, ISOTROPIC


def drawn(count, space=ISOTROPIC):
    return fitted(strokes_in(space, count), space, order=4)


def test_a_model_holds_what_its_method_renders():
    samples = drawn(15)
    field = TextureModel(samples, rate_hz=800.0, at_once=False)
    assert not {"kernel_parameters", "interpolant"} & field.__dict__.keys()
    lsf = smoothed_shapes(samples)
    expected = vertex_table(field.points, samples.power, lsf).table
    np.testing.assert_array_equal(field.vertices, expected)
    published = TextureModel(samples, method="published", rate_hz=800.0, at_once=False)
    expected = vertex_table(published.points, samples.variance, samples.lsf).table
    np.testing.assert_array_equal(published.vertices, expected)
    for model in (field, published):
        made = {"kernel_parameters", "interpolant"}
        assert model.prepared() is model
        assert made <= model.__dict__.keys()
        again = TextureModel.from_bytes(model.to_bytes())
        assert made <= again.__dict__.keys()
        assert (again.method, again.rate_hz) == (model.method, 800.0)


@pytest.mark.parametrize("at_once", [True, False])
def test_a_pickled_model_has_what_was_prepared_and_no_more(*, at_once):
    model = TextureModel(drawn(15), rate_hz=800.0, at_once=at_once)
    again = pickle.loads(pickle.dumps(model))
    assert again.to_bytes() == model.to_bytes()
    assert ("kernel_parameters" in again.__dict__) == ("interpolant" in again.__dict__) == at_once


@pytest.mark.parametrize(("speed", "shape"), [(50.0, (3,)), ([50.0], (1, 3)), ([50, 60], (2, 3))])
def test_a_spectrum_has_a_row_for_each_moment_of_arrays(speed, shape):
    density = TextureModel(drawn(15)).spectrum(speed, 1.0, frequencies_hz=[20.0, 100.0, 400.0])
    assert density.shape == shape


def test_the_level_in_db_is_that_of_the_field_at_the_inputs():
    model = TextureModel(drawn(15))
    assert model.level_field is not None
    found = model.level_db([50.0, 120.0], [1.0, 2.0])
    points = np.array([[50.0 / 300.0, 1.0 / 3.0], [120.0 / 300.0, 2.0 / 3.0]])
    np.testing.assert_allclose(found, model.level_field.level_db(points), rtol=1e-12)


def test_without_power_there_is_no_level_in_db():
    samples = drawn(5)
    silent = TextureSamples(samples.inputs, samples.lsf, 0.0 * samples.power, 0.0 * samples.power)
    with pytest.raises(InputError) as refused:
        TextureModel(silent).level_db(50.0, 1.0)
    assert str(refused.value).startswith("no sample of the model has any power: its level has no")


@pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC])
def test_a_model_tells_what_it_is_and_its_ranges(space):
    samples = drawn(5, space)
    speed, force = (
        f"{values.min():.3g} to {values.max():.3g}"
        for values in (samples.speed_mm_s, samples.force_n)
    )
    assert repr(TextureModel(samples, rate_hz=800.0)) == (
        f"<TextureModel: {space.name}, 5 samples of order 4 at 800 Hz, {speed} mm/s, {force} N, "
        "method field>"
    )


def test_a_model_is_loaded_by_its_name_a_path_or_its_text(tmp_path):
    felt = load_model("felt")
    path = tmp_path / "one.npz"
    for name in (path, str(path)):
        felt.save(name)
        assert load_model(name).to_bytes() == path.read_bytes() == felt.to_bytes()
    with pytest.raises(InputError, match=r"model .*: Is a directory"):
        TextureModel.load(tmp_path)
