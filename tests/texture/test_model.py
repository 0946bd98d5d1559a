import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_samples import stiff
from random_samples import fitted, strokes_in
from scipy.signal import welch

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import lsf_to_ar
from mmt.texture.model.texture_model import TextureModel
from mmt.texture.space import ISOTROPIC
from mmt.texture.synthesis.synthesizer import Synthesizer

FREQUENCIES_HZ = np.linspace(10, 490, 97)


def make_samples(speed, force):
    return fitted(np.column_stack([speed, force]))


def scattered(count, order=8):
    return fitted(strokes_in(ISOTROPIC, count, count), order=order)


def published(samples):
    return TextureModel(samples, method="published")


def test_a_sample_is_reproduced_at_its_own_point():
    samples = scattered(15)
    lsf, variance = published(samples).at(samples.speed_mm_s, samples.force_n)
    np.testing.assert_allclose(lsf, samples.lsf, atol=1e-10)
    np.testing.assert_allclose(variance, samples.variance, rtol=1e-9)


def test_variance_and_frequencies_are_linear_between_samples():
    samples = make_samples([100, 200], [1.5, 1.5])
    shares = np.linspace(0, 1, 11)
    lsf, variance = published(samples).at(100 + 100 * shares, np.full(11, 1.5))
    for found, own in ((variance, samples.variance), (lsf.T[0], samples.lsf[:, 0])):
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


@pytest.mark.parametrize(
    ("speed", "force"),
    [
        ([150.0], [1.5]),
        ([100.0, 200.0], [1.0, 2.0]),
        ([50.0, 100.0, 150.0, 200.0], [0.5, 1.0, 1.5, 2.0]),
        ([120.0] * 6, [1.2] * 6),
        ([120.0, 120.0 + 1e-10], [1.2, 1.2]),
        ([120.0, 120.001], [1.2, 1.2]),
        ([0.0, 300.0, 300.0, 0.0], [0.0, 3.0, 0.0, 3.0]),
        ([500.0, 1e6], [7.0, 1.0]),
        ([60.0, 300.0], [0.6, 1.8]),
    ],
    ids="one two collinear repeated coincident near corners outside on-edge".split(),  # noqa: SIM905
)
def test_degenerate_sample_sets_give_a_finite_stable_model(speed, force):
    model = published(make_samples(speed, force))
    grid_speed, grid_force = np.meshgrid(np.linspace(0, 300, 31), np.linspace(0, 3, 31))
    lsf, variance = model.at(grid_speed.ravel(), grid_force.ravel())
    assert np.isfinite(variance).all()
    assert (variance >= 0).all()
    assert (np.diff(lsf, axis=1, prepend=0.0, append=np.pi) > 0).all()


def test_repeated_samples_become_one_vertex_with_their_mean():
    samples = make_samples([120.0, 120.0], [1.2, 1.2])
    lsf, _ = published(samples).at(120.0, 1.2)
    np.testing.assert_allclose(lsf[0], samples.lsf.mean(axis=0), atol=1e-12)


def test_spectrum_is_the_filters():
    model = TextureModel(scattered(9))
    lsf, variance = model.at(130.0, 1.1)
    ar = np.concatenate([[1.0], lsf_to_ar(lsf)[0]])
    response = np.abs(np.exp(-2j * np.pi * np.outer(FREQUENCIES_HZ / 1000, np.arange(9))) @ ar)
    np.testing.assert_allclose(
        model.spectrum(130.0, 1.1, frequencies_hz=FREQUENCIES_HZ),
        2 * variance[0] / 1000 / response**2,
        rtol=1e-9,
    )


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
    with path.open("wb") as file:
        np.savez(file, format_version=99)
    with pytest.raises(InputError, match="version is 99"):
        TextureModel.load(path)
    with path.open("wb") as file:
        np.savez(file, format_version=1)
    with pytest.raises(InputError, match="missing"):
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


@pytest.mark.parametrize("inside", [1e-16, 1e-12, 1e-9, 1e-7])
def test_samples_beside_an_edge_lie_on_it(inside):
    near = 1.0 - inside
    model = published(
        make_samples([300 * near, 300 * near, 100.0, 0.0], [3 * near, 1.1, 3 * near, 3 * inside])
    )
    corners = model.vertices[model.triangles[:, :3], :2]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    assert areas.sum() == pytest.approx(1.0, abs=1e-12)
    assert areas.min() > 1e-4


# --- synthesis


@settings(max_examples=25)
@given(
    st.lists(st.integers(1, 700), min_size=1, max_size=12),
    st.sampled_from([1, 7, 10, 100]),
    st.integers(0, 2**32),
)
def test_the_output_does_not_depend_on_the_block_size(blocks, renewal, seed):
    model = TextureModel(scattered(12))
    count = sum(blocks)
    generator = np.random.default_rng(1)
    speed = generator.uniform(-10, 320, count)
    force = generator.uniform(-0.1, 3.2, count)
    whole = Synthesizer(model, seed=seed, renewal_samples=renewal).render(speed, force)
    pieces = Synthesizer(model, seed=seed, renewal_samples=renewal)
    ends = np.cumsum(blocks)
    joined = np.concatenate(
        [
            pieces.render(speed[e - n : e].copy(), force[e - n : e].copy())
            for n, e in zip(blocks, ends, strict=True)
        ]
    )
    np.testing.assert_array_equal(whole, joined)


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
