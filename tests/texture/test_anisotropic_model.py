from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_samples import fitted, strokes_in
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator
from scipy.spatial import Delaunay

from mmt.core.errors import InputError
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import ANISOTROPIC, ISOTROPIC, InputSpace, normalise_into
from mmt.texture.synthesis.synthesizer import Synthesizer

strokes = partial(strokes_in, ANISOTROPIC)
fitted_at = partial(fitted, space=ANISOTROPIC)


def everywhere(count):
    """Return inputs (count, 3) within and beyond the space."""
    return np.random.default_rng(2).uniform([-400, -400, -0.5], [400, 400, 3.5], (count, 3))


METHODS = ("field", "published")


def test_the_network_is_that_of_scipy_where_it_is_a_filter():
    texture = fitted_at(strokes(60), order=2)
    whole = RBFInterpolator(texture.points, np.column_stack([texture.variance, texture.lsf]))
    inputs = everywhere(2000)
    expected = whole(ANISOTROPIC.normalise(inputs))
    lsf, variance = TextureModel(texture, method="published").at(*inputs.T)
    inside = ((expected >= whole.d.min(axis=0)) & (expected <= whole.d.max(axis=0))).all(axis=1)
    inside &= (np.diff(expected[:, 1:], axis=1) > 0.03).ravel()
    inside &= np.hypot(inputs[:, 0], inputs[:, 1]) > texture.speed_mm_s.min()
    inside &= inputs[:, 2] > texture.force_n.min()
    assert inside.sum() > 50
    np.testing.assert_allclose(lsf[inside], expected[inside, 1:], rtol=1e-9)
    np.testing.assert_allclose(variance[inside], expected[inside, 0], rtol=1e-6)


def test_the_frequencies_of_a_field_are_scipys_between_its_vertices():
    model = TextureModel(fitted_at(strokes(60)))
    inputs = everywhere(2000)
    points = ANISOTROPIC.normalise(inputs)
    scipys = LinearNDInterpolator(Delaunay(model.vertices[:, :3]), model.vertices[:, 4:])(points)
    np.testing.assert_allclose(model.at(*inputs.T)[0], scipys, atol=1e-8)


@settings(max_examples=30)
@given(st.integers(1, 30), st.integers(0, 2**32), st.sampled_from(METHODS))
def test_any_samples_give_ordered_frequencies(count, seed, method):
    samples = fitted_at(np.round(strokes(count, seed), 1))
    model = TextureModel(samples, method=method)
    lsf, variance = model.at(*everywhere(200).T)
    assert (np.diff(lsf, axis=1, prepend=0.0, append=np.pi) > 0).all()
    assert (variance >= 0).all()


def test_a_velocity_beyond_the_largest_keeps_its_heading():
    model = TextureModel(fitted_at(strokes(50)))
    for slow, fast in zip(model.at(180.0, 240.0, 1.0), model.at(1800.0, 2400.0, 1.0), strict=True):
        np.testing.assert_allclose(slow, fast, rtol=1e-9)
    beyond = ANISOTROPIC.normalise(np.array([[np.inf, np.inf, np.inf], [np.nan, 5.0, np.nan]]))
    np.testing.assert_allclose(beyond, [[0.5**0.5, 0.5**0.5, 1.0], [0.0, 5 / 300, 0.0]])


@settings(max_examples=100)
@given(st.tuples(*[st.floats(width=64)] * 3), st.sampled_from([ISOTROPIC, ANISOTROPIC]))
def test_one_moment_is_normalised_as_many_are(moment, space):
    inputs = np.array([moment[: space.dimensions]])
    point = np.empty(space.dimensions)
    normalise_into(*moment, 1 / space.maximum_speed_mm_s, 1 / space.maximum_force_n, point)
    np.testing.assert_allclose(point, space.normalise(inputs)[0], atol=1e-12)


def test_a_motion_gives_the_inputs_of_either_space():
    np.testing.assert_allclose(ISOTROPIC.from_motion(30.0, -40.0, 1.5), [[50.0, 1.5]])
    np.testing.assert_allclose(ANISOTROPIC.from_motion(30.0, -40.0, 1.5), [[30.0, -40.0, 1.5]])
    samples = fitted_at(np.array([[30.0, -40.0, 1.5]]))
    np.testing.assert_allclose(samples.speed_mm_s, [50.0])


def test_the_wrong_number_of_inputs_is_explained():
    model = TextureModel(fitted_at(strokes(3)))
    with pytest.raises(InputError, match="velocity_x_mm_s"):
        model.at(100.0)
    with pytest.raises(InputError, match="velocity_x_mm_s"):
        Synthesizer(model).render(np.ones(3))
    columns = np.ones((3, 3))
    assert len(Synthesizer(model).render(*columns.T)) == 3
    with pytest.raises(InputError, match=r"\(3,\) float64, \(2,\) float64, \(3,\) float64: each"):
        Synthesizer(model).render(columns[0], columns[1, :2], columns[2])
    for inputs in ((columns[0], columns[1, :2], columns[2]), (columns, 1.0, 1.0)):
        with pytest.raises(InputError, match=r"inputs have shapes \(.*each must be \(n,\)"):
            model.at(*inputs)
    with pytest.raises(InputError, match='"isotropic", "anisotropic"'):
        InputSpace("directed")
    with pytest.raises(InputError, match="maximum_force_n"):
        InputSpace("isotropic", 300.0, 0.0)
    with pytest.raises(InputError, match="method is 'spline', allowed are field, published"):
        TextureModel(fitted_at(strokes(3)), method="spline")
