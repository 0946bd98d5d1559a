"""A texture model as a surface: its truth is exact, and not what any model interpolates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter, welch
from typer.testing import CliRunner

import mmt
from mmt.cli.main import app
from mmt.core.errors import InputError
from mmt.evaluation.truth import known_texture
from mmt.testing.simulation.surfaces.course import course_from_annotations
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations
from mmt.testing.simulation.surfaces.model_surface import (
    ModelSurface,
    ModelVibration,
    filter_side_by_side,
)
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt.testing.simulation.surfaces.vibration import Stroke
from mmt.texture import TextureModel
from mmt.texture.space import InputSpace, TextureSamples
from mmt_bridges.hatt.models import export_hatt

FREQUENCIES_HZ = np.arange(501.0)


def made(inputs="isotropic", count=25, order=6, seed=3, fastest_mm_s=300.0):
    """A model whose filters have nothing in common."""
    rng = np.random.default_rng(seed)
    space = InputSpace(inputs, fastest_mm_s, 3.0)
    lsf = np.sort(rng.uniform(0.1, np.pi - 0.1, (count, order)), axis=1)
    lsf += 0.02 * np.arange(order)
    lsf *= (np.pi - 0.05) / lsf.max()
    speed, force = rng.uniform(20, fastest_mm_s, count), rng.uniform(0.1, 3.0, count)
    heading = rng.uniform(-np.pi, np.pi, count)
    columns = [speed, force]
    if inputs == "anisotropic":
        columns = [speed * np.cos(heading), speed * np.sin(heading), force]
    power = rng.uniform(0.5, 5.0, count)
    return TextureModel(
        TextureSamples(np.column_stack(columns), lsf, power, power, space), method="published"
    )


@pytest.mark.parametrize(("inputs", "heading"), [("isotropic", None), ("anisotropic", 0.7)])
def test_the_power_is_the_integral_of_the_spectrum(inputs, heading):
    surface = ModelSurface("x", made(inputs))
    stroke = [40.0, 130.0, 299.0], [0.2, 1.7, 2.9]
    fine = np.linspace(0.0, 500.0, 40_001)
    density = surface.spectrum(*stroke, fine, heading)
    np.testing.assert_allclose(
        np.trapezoid(density, fine, axis=1), surface.power(*stroke, heading), rtol=2e-3
    )


def test_at_a_models_point_the_texture_is_its_filter_and_between_them_the_mean():
    model = made()
    surface = ModelSurface("x", model)
    inputs = model.samples.inputs[4]
    np.testing.assert_allclose(
        surface.spectrum(*inputs, FREQUENCIES_HZ)[0],
        model.spectrum(*inputs, frequencies_hz=FREQUENCIES_HZ),
        rtol=1e-9,
    )
    corners, weights = surface.weights(np.array([[0.4, 0.5]]))
    ends = [surface.points[c] * model.space.scale for c in corners[0]]
    mean = sum(
        w * surface.spectrum(*end, FREQUENCIES_HZ) for w, end in zip(weights[0], ends, strict=True)
    )
    np.testing.assert_allclose(surface.spectrum(120.0, 1.5, FREQUENCIES_HZ), mean, rtol=1e-6)


@pytest.mark.parametrize(
    ("inputs", "heading", "samples"),
    [("isotropic", None, 1), ("anisotropic", -2.0, 1), ("isotropic", None, 5)],
)
def test_the_vibration_has_the_spectrum_that_is_known(inputs, heading, samples):
    rate_hz = 1000.0 * samples
    surface = ModelSurface("x", made(inputs), rate_hz=rate_hz)
    generator = ModelVibration(surface, np.random.default_rng(1))
    towards = (1.0, 0.0) if heading is None else (np.cos(heading), np.sin(heading))
    frames = [generator.run(samples, Stroke(110.0, 1.3, towards)) for _ in range(60_000)]
    values = np.concatenate(frames)
    frequencies, measured = welch(values[:, 0], rate_hz, nperseg=1000 * samples)
    expected = surface.spectrum(110.0, 1.3, frequencies, heading)[0]
    error_db = 10 * np.log10(measured / expected)[10:490]
    assert abs(np.median(error_db)) < 0.2  # that of 119 halves of a window is 0.06
    assert np.median(np.abs(error_db)) < 0.6
    assert values[:, 0].var() == pytest.approx(surface.power(110.0, 1.3, heading)[0], rel=0.15)
    assert values[:, 1].var() / values[:, 0].var() == pytest.approx(0.09, rel=0.2)


def test_its_range_is_that_of_a_session():
    slow = made(fastest_mm_s=100.0)
    surface = ModelSurface("x", slow)
    inputs = slow.samples.inputs[2]
    np.testing.assert_allclose(
        surface.spectrum(3.0 * inputs[0], inputs[1], FREQUENCIES_HZ)[0],
        slow.spectrum(*inputs, frequencies_hz=FREQUENCIES_HZ),
        rtol=1e-9,
    )


@pytest.mark.parametrize("stroke", [(0.0, 0.0), (1e9, 1e9), (-5.0, 2.0), (300.0, 0.0)])
def test_at_the_ends_of_the_plane_it_stays_finite(stroke):
    surface = ModelSurface("x", made())
    assert np.isfinite(surface.spectrum(*stroke, FREQUENCIES_HZ)).all()
    generator = ModelVibration(surface, np.random.default_rng(1))
    assert np.isfinite([generator.step(Stroke(*stroke)) for _ in range(300)]).all()


@pytest.mark.parametrize("suffix", [".npz", ".xml"])
def test_a_file_is_a_surface_whose_truth_travels_with_the_session(tmp_path, suffix):
    model, path = made(), tmp_path / f"stone{suffix}"
    path.write_bytes(model.to_bytes() if suffix == ".npz" else export_hatt(model, "stone", 0.45))
    out = tmp_path / "a.mcap"
    arguments = ["session", "simulate", str(out), "--surface", str(path), "--duration", "12"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    session = mmt.read_session(out)
    surface = surface_from_annotations(session.annotations)
    assert surface.name == "stone"
    if suffix == ".xml":
        assert surface.friction_coefficient == 0.45
    stroke = [60.0, 200.0], [0.6, 2.0]
    np.testing.assert_allclose(
        surface.power(*stroke), ModelSurface("x", model).power(*stroke), rtol=0.02
    )
    assert known_texture(session.annotations, mmt.ModellingSettings())[0] is not None
    result = mmt.evaluate_session(session)
    assert result.basis == "truth"
    assert result.at_end.within_jnd is not None


def test_it_may_be_one_of_a_course(tmp_path):
    path = tmp_path / "stone.npz"
    path.write_bytes(made().to_bytes())
    simulated = {"surface": "wood", "course": {"surfaces": [str(path)], "stay_s": 2.0}}
    scene = mmt.Scene.model_validate(
        {"simulated": simulated, "hand": {}, "link": {}, "texture": {}}
    )
    frames, truth = mmt.simulate_session(scene, duration_s=6.0)
    assert len(frames) == 6000
    assert [surface.name for surface in course_from_annotations(truth).surfaces] == [
        "wood",
        "stone",
    ]


def test_what_cannot_be_a_surface_is_explained(tmp_path):
    with pytest.raises(InputError, match=r"surface is 'stone', allowed are plastic.*\.npz, \.xml"):
        get_surface("stone")
    with pytest.raises(InputError, match=r"[Nn]o such file"):
        get_surface(str(tmp_path / "absent.npz"))


def test_a_model_becomes_a_surface_of_any_rate(tmp_path):
    mmt.load_model("felt").save(tmp_path / "stone.npz")
    slow, fast = (get_surface(str(tmp_path / "stone.npz"), rate) for rate in (1000.0, 5000.0))
    assert (slow.rate_hz, fast.rate_hz) == (1000.0, 5000.0)
    below_hz, above_hz = np.arange(20.0, 450.0), np.arange(600.0, 2500.0)
    one, other = (s.spectrum(120.0, 1.5, below_hz)[0] for s in (slow, fast))
    assert np.sqrt(np.mean((10.0 * np.log10(other / one)) ** 2)) < 3.0
    assert fast.spectrum(120.0, 1.5, above_hz).mean() < 0.1 * other.mean()
    assert surface_from_annotations(slow.annotations()).rate_hz == 1000.0
    again = surface_from_annotations(fast.annotations())
    np.testing.assert_array_equal(again.coefficients, fast.coefficients)
    assert again.rate_hz == 5000.0


@settings(max_examples=20)
@given(st.integers(1, 20), st.integers(1, 7), st.lists(st.integers(1, 9), min_size=1, max_size=9))
def test_filters_side_by_side_are_those_of_scipy(order, filters, counts):
    random = np.random.default_rng([order, filters])
    poles = 0.9 * random.uniform(-1.0, 1.0, (filters, order))
    polynomials = np.array([np.poly(each) for each in poles])
    noise = random.standard_normal((sum(counts), filters))
    outputs = np.zeros((order + len(noise), filters))
    backward = np.ascontiguousarray(polynomials[:, :0:-1].T)
    start = 0
    for count in counts:
        filter_side_by_side(backward, noise[start : start + count], outputs, start)
        start += count
    for each, polynomial in enumerate(polynomials):
        expected = lfilter([1.0], polynomial, noise[:, each])
        np.testing.assert_allclose(outputs[order:, each], expected, rtol=1e-6, atol=1e-6)


def test_experiments_take_files_and_folders(tmp_path):
    from mmt_lab.harness.experiment import chosen_textures

    for name in "b.npz", "a.npz":
        (tmp_path / name).write_bytes(made().to_bytes())
    (tmp_path / "readme.txt").write_text("no model")
    folder, one = str(tmp_path), str(tmp_path / "b.npz")
    assert chosen_textures(f"wood, {folder}") == ["wood", str(tmp_path / "a.npz"), one]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no model"):
        chosen_textures(str(tmp_path / "empty"))
