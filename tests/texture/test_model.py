"""What a model is made of, what it tells of itself, and how it is rendered."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_samples import model, stiff
from random_samples import fitted, strokes_in
from scipy.signal import freqz, welch

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.field.shape_smoothing import smoothed_shapes
from mmt.texture.interpolation.vertices import vertex_table
from mmt.texture.model.texture_model import TextureModel, load_model
from mmt.texture.space import ANISOTROPIC, ISOTROPIC, TextureSamples
from mmt.texture.synthesis.synthesizer import Synthesizer

FREQUENCIES_HZ = np.linspace(10, 490, 97)


def make_samples(speed, force):
    return fitted(np.column_stack([speed, force]))


def scattered(count, space=ISOTROPIC, *, order=8):
    return fitted(strokes_in(space, count, count), space, order=order)


def published(samples):
    return TextureModel(samples, method="published")


def test_variance_and_frequencies_are_linear_from_sample_to_sample():
    samples = make_samples([100, 200], [1.5, 1.5])
    shares = np.linspace(0, 1, 11)
    lsf, variance = published(samples).at(100 + 100 * shares, np.full(11, 1.5))
    for found, own in zip((variance, *lsf.T), (samples.variance, *samples.lsf.T), strict=True):
        np.testing.assert_allclose(found, (1 - shares) * own[0] + shares * own[1], rtol=1e-9)


@pytest.mark.parametrize("method", ["field", "published"])
def test_no_vibration_without_speed_or_force(method):
    model = TextureModel(scattered(20), method=method)
    for speed, force in [(0.0, 1.0), (150.0, 0.0), (0.0, 0.0), (np.nan, 1.0), (-50.0, 1.0)]:
        _, variance = model.at(speed, force)
        assert variance[0] == 0.0


def test_the_maximum_edges_copy_their_nearest_sample():
    samples = make_samples([150], [1.5])
    model = published(samples)
    lsf, variance = model.at([300.0, 300.0, 900.0], [3.0, 1.8, 70.0])
    np.testing.assert_allclose(lsf, np.repeat(samples.lsf, 3, axis=0), atol=1e-10)
    np.testing.assert_allclose(variance, samples.variance[0], rtol=1e-9)


def test_spectrum_is_the_filters():
    model = TextureModel(scattered(9))
    lsf, variance = model.at(130.0, 1.1)
    found = model.spectrum(130.0, 1.1, frequencies_hz=FREQUENCIES_HZ)
    _, response = freqz(1.0, np.append(1.0, lsf_to_ar(lsf)[0]), FREQUENCIES_HZ, fs=1000.0)
    expected = 2 * variance[0] / 1000 * np.abs(response) ** 2
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_model_cannot_be_changed():
    samples = scattered(5)
    model = published(samples)
    for array in (model.samples.lsf, model.points):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 0.0
    before = model.at(100.0, 1.0)[0]
    samples.lsf[:] = 0.5
    np.testing.assert_array_equal(model.at(100.0, 1.0)[0], before)


def test_a_bad_file_is_explained(tmp_path):
    path = tmp_path / "model.npz"
    with pytest.raises(InputError, match="No such file"):
        TextureModel.load(path)
    for content in (b"", b"garbage", TextureModel(scattered(3)).to_bytes()[:-40]):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"model\.npz"):
            TextureModel.load(path)


@pytest.mark.parametrize("apart", [1e-15, 1e-12, 1e-9])
def test_samples_beside_each_other_are_one_vertex_wherever_they_lie(apart):
    centres = (np.round(np.random.default_rng(2).uniform(0.1, 0.9, (20, 2)) * 1e6) + 0.5) / 1e6
    around = 0.5 * apart * np.array([(-1, 0), (1, 0), (0, 1), (0, -1)])
    points = (centres[:, None, :] + around).reshape(-1, 2)
    samples = fitted(points * ISOTROPIC.scale)
    model = published(samples)
    assert len(model.vertices) == 20 + 20
    lsf, _ = model.at(300 * centres[:, 0], 3 * centres[:, 1])
    np.testing.assert_allclose(lsf, samples.lsf.reshape(20, 4, -1).mean(axis=1), atol=1e-8)


@settings(max_examples=40)
@given(
    st.lists(st.integers(1, 700), min_size=1, max_size=12),
    st.sampled_from([1, 7, 10, 100]),
    st.integers(0, 2**32),
    st.sampled_from([ISOTROPIC, ANISOTROPIC]),
    st.booleans(),
)
def test_the_output_depends_on_the_excitation_or_its_seed_and_on_no_blocks(
    blocks, renewal, seed, space, excited
):
    made = TextureModel(scattered(12, space))
    random, count = np.random.default_rng(1), sum(blocks)
    inputs = random.uniform(-10, 320, (space.dimensions, count))
    inputs[-1] *= 0.01  # the force
    white = random.standard_normal(count)

    def rendered(by, at):
        given = {"excitation": white[at].copy()} if excited else {}
        return by.render(*inputs[:, at].copy(), **given)

    whole, pieces = (
        Synthesizer(made, seed=seed + excited * number, renewal_samples=renewal)
        for number in range(2)
    )
    edges = np.cumsum([0, *blocks])
    joined = np.concatenate([rendered(pieces, slice(a, b)) for a, b in pairwise(edges)])
    np.testing.assert_array_equal(rendered(whole, slice(None)), joined, strict=True)
    assert joined.any() or count < 50


def test_the_rendered_spectrum_is_the_models():
    model = TextureModel(scattered(12))
    count = 120_000
    output = Synthesizer(model, seed=3, limit_m_s2=1e6).render(
        np.full(count, 140.0), np.full(count, 1.3)
    )
    frequencies, measured = welch(output, 1000.0, nperseg=512)
    inside = (frequencies > 15) & (frequencies < 485)
    expected = model.spectrum(140.0, 1.3, frequencies_hz=frequencies[inside])
    error_db = 10 * np.log10(measured[inside] / expected)
    assert np.sqrt(np.mean(error_db**2)) < 0.6


def test_silent_at_rest_and_exactly_so_soon_after():
    synthesizer = Synthesizer(TextureModel(scattered(12)), seed=1)
    synthesizer.render(np.full(500, 150.0), np.full(500, 1.5))
    after = synthesizer.render(np.zeros(400), np.full(400, 1.5))
    assert after[0] != 0.0
    assert np.abs(after[60:]).max() < 1e-3
    assert (after[200:] == 0.0).all()
    assert (synthesizer.render(np.full(300, 150.0), np.zeros(300))[250:] == 0.0).all()


def test_without_a_model_it_is_silent():
    synthesizer = Synthesizer(seed=1)
    assert (synthesizer.render(np.full(50, 150.0), np.full(50, 1.5)) == 0.0).all()
    synthesizer.model = TextureModel(scattered(12))
    assert synthesizer.render(np.full(50, 150.0), np.full(50, 1.5)).any()
    synthesizer.model = None
    assert (synthesizer.render(np.full(400, 150.0), np.full(400, 1.5))[-100:] == 0.0).all()


def test_bounded_while_filters_and_models_are_swapped():
    generator = np.random.default_rng(9)
    models = [stiff(9), published(scattered(9, order=3))]
    synthesizer = Synthesizer(models[0], seed=2, limit_m_s2=40.0)
    for block in range(200):
        synthesizer.model = models[block % 2]
        output = synthesizer.render(generator.uniform(0, 300, 50), generator.uniform(0, 3, 50))
        assert np.isfinite(output).all()
        assert np.abs(output).max() <= 40.0


def test_bad_inputs_are_silence():
    synthesizer = Synthesizer(TextureModel(scattered(12)), seed=1)
    bad = np.array([np.nan, -5.0, -np.inf] * 10)
    assert (synthesizer.render(bad, np.full(30, 1.0)) == 0.0).all()
    fast = synthesizer.render(np.full(30, np.inf), np.full(30, 1.0))
    assert np.isfinite(fast).all()
    assert fast.any()
    assert len(synthesizer.render(np.empty(0), np.empty(0))) == 0


def test_without_excitation_only_what_the_filter_remembers_is_heard():
    speed, force = np.full(3000, 100.0), np.ones(3000)
    rendered = Synthesizer(model(), seed=1)
    assert not rendered.render(speed, force, excitation=np.zeros(3000)).any()
    before = rendered.render(speed, force)
    after = rendered.render(speed, force, excitation=np.zeros(3000))
    assert np.abs(after[:5]).max() > 0.01 * np.abs(before).max()
    assert np.abs(after[-100:]).max() < 1e-6 * np.abs(after[:100]).max()


@pytest.mark.parametrize(
    ("excitation", "words"),
    [
        (np.zeros(99), "has shape"),
        (np.zeros((100, 1)), "has shape"),
        (np.full(100, np.nan), "has shape"),
        (np.zeros(100, complex), "is"),
        ("white", "is"),
        ([[0.0], [0.0, 0.0]], "is"),
    ],
)
def test_an_excitation_that_does_not_fit_is_refused(excitation, words):
    with pytest.raises(InputError, match=f"excitation {words}"):
        Synthesizer(model()).render(np.full(100, 100.0), np.ones(100), excitation=excitation)


@pytest.mark.parametrize(
    "change",
    [np.float32, np.int64, lambda x: x.astype(">f8"), list, lambda x: np.repeat(x, 2)[::2],
     lambda x: np.frombuffer(x.tobytes())],
)  # fmt: skip
def test_inputs_of_any_real_type_give_the_same_samples(change):
    inputs = np.arange(100.0, 300.0), np.full(200, 2.0)
    changed = map(change, inputs)
    expected = Synthesizer(model(), seed=1).render(*inputs)
    np.testing.assert_array_equal(Synthesizer(model(), seed=1).render(*changed), expected)
    assert len(Synthesizer(model()).render([], [])) == 0
    with pytest.raises(InputError, match="real numbers are needed"):
        Synthesizer(model()).render(["fast"], ["hard"])


@pytest.mark.parametrize("inputs", [(), (100.0, 1.0), (None, None), (np.ones((3, 1)),) * 2])
@pytest.mark.parametrize("rendered", [model(), None])
def test_inputs_that_are_no_rows_are_refused(inputs, rendered):
    with pytest.raises(InputError, match=r"each must be \(n,\) numbers"):
        Synthesizer(rendered).render(*inputs)


@pytest.mark.parametrize(
    ("name", "value"),
    [("seed", -1), ("renewal_samples", 0), ("renewal_samples", 1.5), ("limit_m_s2", np.nan)],
)
def test_numbers_of_a_synthesizer_are_checked(name, value):
    with pytest.raises(InputError, match=f"{name} is {value}, allowed is a"):
        Synthesizer(model(), **{name: value})


def test_the_name_of_a_model_is_none():
    with pytest.raises(InputError, match="model is 'oak', allowed is TextureModel or None"):
        Synthesizer("oak")


def test_a_model_holds_what_its_method_renders():
    samples = scattered(15)
    field = TextureModel(samples, rate_hz=800.0, at_once=False)
    assert not {"kernel_parameters", "interpolant"} & field.__dict__.keys()
    lsf = smoothed_shapes(samples)
    expected = vertex_table(field.points, samples.power, lsf).table
    np.testing.assert_array_equal(field.vertices, expected)
    published = TextureModel(samples, method="published", rate_hz=800.0, at_once=False)
    expected = vertex_table(published.points, samples.variance, samples.lsf).table
    np.testing.assert_array_equal(published.vertices, expected)
    for each in (field, published):
        made = {"kernel_parameters", "interpolant"}
        assert each.prepared() is each
        assert made <= each.__dict__.keys()
        again = TextureModel.from_bytes(each.to_bytes())
        assert made <= again.__dict__.keys()
        assert (again.method, again.rate_hz) == (each.method, 800.0)


@pytest.mark.parametrize("at_once", [True, False])
def test_a_pickled_model_has_what_was_prepared_and_no_more(*, at_once):
    model = TextureModel(scattered(15), rate_hz=800.0, at_once=at_once)
    again = pickle.loads(pickle.dumps(model))
    assert again.to_bytes() == model.to_bytes()
    assert ("kernel_parameters" in again.__dict__) == ("interpolant" in again.__dict__) == at_once


@pytest.mark.parametrize(("speed", "shape"), [(50.0, (3,)), ([50.0], (1, 3)), ([50, 60], (2, 3))])
def test_a_spectrum_has_a_row_for_each_moment_of_arrays(speed, shape):
    density = TextureModel(scattered(15)).spectrum(speed, 1.0, frequencies_hz=[20.0, 100.0, 400.0])
    assert density.shape == shape


def test_the_level_in_db_is_that_of_the_field_at_the_inputs():
    model = TextureModel(scattered(15))
    assert model.level_field is not None
    found = model.level_db([50.0, 120.0], [1.0, 2.0])
    points = np.array([[50.0 / 300.0, 1.0 / 3.0], [120.0 / 300.0, 2.0 / 3.0]])
    np.testing.assert_allclose(found, model.level_field.level_db(points), rtol=1e-12)


def test_without_power_there_is_no_level_in_db():
    samples = scattered(5)
    silent = TextureSamples(samples.inputs, samples.lsf, 0.0 * samples.power, 0.0 * samples.power)
    with pytest.raises(InputError) as refused:
        TextureModel(silent).level_db(50.0, 1.0)
    assert str(refused.value).startswith("no sample of the model has any power: its level has no")


@pytest.mark.parametrize("space", [ISOTROPIC, ANISOTROPIC])
def test_a_model_tells_what_it_is_and_its_ranges(space):
    samples = scattered(5, space)
    speed, force = (
        f"{values.min():.3g} to {values.max():.3g}"
        for values in (samples.speed_mm_s, samples.force_n)
    )
    assert repr(TextureModel(samples, rate_hz=800.0)) == (
        f"<TextureModel: {space.name}, 5 samples of order 8 at 800 Hz, {speed} mm/s, {force} N, "
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
