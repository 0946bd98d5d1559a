"""What a model is made from: its options, an earlier state of it, and what was fitted before."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import output_power, reflection_to_lsf
from mmt.texture.field.shape_smoothing import smoothed_shapes
from mmt.texture.field.trend import NO_TREND, fit_trend
from mmt.texture.interpolation.vertices import vertex_table
from mmt.texture.model import texture_model
from mmt.texture.model.inputs import ANISOTROPIC, ISOTROPIC, InputSpace
from mmt.texture.model.texture_model import TextureModel, TextureSamples, load_model


def drawn(count: int, space: InputSpace = ISOTROPIC, *, order: int = 4) -> TextureSamples:
    generator = np.random.default_rng(count)
    reflection = generator.uniform(-0.6, 0.6, (count, order))
    variance = generator.uniform(0.5, 2.0, count)
    motion = generator.uniform(20.0, 200.0, (count, space.dimensions - 1))
    inputs = np.column_stack([motion, generator.uniform(0.2, 2.8, count)])
    power = output_power(variance, reflection)
    return TextureSamples(inputs, reflection_to_lsf(reflection), variance, power, space)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"interpolate": "x"}, "interpolate is 'x', allowed are variance, power, amplitude"),
        ({"level": "x"}, "level is 'x', allowed are interpolated, gaussian_process"),
        ({"shape": "x"}, "shape is 'x', allowed are measured, smoothed"),
        (
            {"level": "gaussian_process", "interpolate": "variance"},
            "level 'gaussian_process' needs interpolate \"power\", not 'variance'",
        ),
    ],
)
def test_options_that_are_none_are_named(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError) as refused:
        TextureModel(drawn(5), **options)
    assert str(refused.value) == sentence


def test_the_points_of_a_model_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        TextureModel(drawn(5)).points[0] = 0.0


class Builds:
    """Notes what an interpolator was built from."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.befores: list[object] = []
        self.states: list[object] = []
        load = texture_model.load

        def watched(name: str) -> Any:
            build = load(name)

            def noted(vertices: Any, before: Any, state: Any) -> Any:
                self.befores.append(before)
                self.states.append(state)
                return build(vertices, before, state)

            return noted

        monkeypatch.setattr(texture_model, "load", watched)


def test_a_model_grows_from_an_earlier_one_that_is_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    builds = Builds(monkeypatch)
    first = TextureModel(drawn(12), interpolator="rbf")
    TextureModel(drawn(13), interpolator="rbf", previous=first)
    TextureModel(drawn(13), interpolator="nearest", previous=first)
    TextureModel(drawn(13), interpolator="rbf", interpolate="variance", previous=first)
    TextureModel(drawn(13), interpolator="rbf", shape="smoothed", previous=first)
    TextureModel(drawn(13, order=5), interpolator="rbf", previous=first)
    TextureModel(drawn(13, ANISOTROPIC), interpolator="rbf", previous=first)
    assert builds.befores == [None, first.interpolant, None, None, None, None, None]
    assert builds.states == [None] * 7


@pytest.mark.parametrize("interpolate", ["power", "amplitude", "variance"])
def test_what_was_fitted_is_taken_and_not_fitted_anew(
    interpolate: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    samples = drawn(15, ANISOTROPIC)
    model = TextureModel(samples, interpolate=interpolate, interpolator="rbf")
    values = {"power": samples.power, "amplitude": np.sqrt(samples.power)}
    trend = fit_trend(
        model.points,
        values.get(interpolate, samples.variance),
        is_amplitude=interpolate == "amplitude",
    )
    assert tuple(model.trend) == tuple(trend) != tuple(NO_TREND)
    builds = Builds(monkeypatch)
    monkeypatch.setattr(texture_model, "fit_trend", None)
    again = TextureModel.from_bytes(model.to_bytes())
    np.testing.assert_allclose(tuple(again.trend), tuple(model.trend), rtol=1e-12)
    assert again.interpolate == interpolate
    assert builds.states != [None]
    np.testing.assert_array_equal(again.at(50.0, 40.0, 1.0)[1], model.at(50.0, 40.0, 1.0)[1])


@pytest.mark.parametrize("level", ["interpolated", "gaussian_process"])
@pytest.mark.parametrize("shape", ["measured", "smoothed"])
def test_smoothed_shapes_have_vertices_inside_where_the_level_needs_none(
    level: Any, shape: Any
) -> None:
    samples = drawn(15)
    model = TextureModel(samples, level=level, shape=shape, rate_hz=800.0)
    inside = (level, shape) == ("gaussian_process", "smoothed")
    lsf = smoothed_shapes(samples, inside=inside) if shape == "smoothed" else samples.lsf
    expected = vertex_table(model.points, samples.power, lsf, inside=inside).table
    np.testing.assert_array_equal(model.vertices, expected)
    made = {"kernel_parameters", "level_field"} & model.__dict__.keys()
    assert bool(made) == (level == "gaussian_process")
    again = TextureModel.from_bytes(model.to_bytes())
    assert (again.level, again.shape, again.rate_hz) == (level, shape, 800.0)


def test_the_level_in_db_is_that_of_the_field_at_the_inputs() -> None:
    model = TextureModel(drawn(15))
    assert model.level_field is not None
    found = model.level_db([50.0, 120.0], [1.0, 2.0])
    points = np.array([[50.0 / 300.0, 1.0 / 3.0], [120.0 / 300.0, 2.0 / 3.0]])
    np.testing.assert_allclose(found, model.level_field.level_db(points), rtol=1e-12)


def test_without_power_there_is_no_level_in_db() -> None:
    samples = drawn(5)
    silent = TextureSamples(samples.inputs, samples.lsf, 0.0 * samples.power, 0.0 * samples.power)
    with pytest.raises(InputError) as refused:
        TextureModel(silent).level_db(50.0, 1.0)
    assert str(refused.value).startswith("no sample of the model has any power: its level has no")


def test_a_model_tells_its_ranges() -> None:
    samples = drawn(5)
    low, high = samples.force_n.min(), samples.force_n.max()
    assert f" mm/s, {low:.3g} to {high:.3g} N, interpolator delaunay" in repr(TextureModel(samples))


def test_a_model_is_loaded_by_its_name_a_path_or_its_text(tmp_path: Path) -> None:
    felt = load_model("felt")
    felt.save(tmp_path / "one.npz")
    for source in (tmp_path / "one.npz", str(tmp_path / "one.npz")):
        assert load_model(source).to_bytes() == felt.to_bytes()
    with pytest.raises(InputError, match=r"model .*: Is a directory"):
        TextureModel.load(tmp_path)
