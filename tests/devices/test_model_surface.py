"""A texture model as a surface: its truth is exact, and not what any model interpolates."""

import numpy as np
import pytest
from command_runs import output_of
from hypothesis import given, settings
from hypothesis import strategies as st
from known_surface_samples import odd_model
from scipy.signal import lfilter

import mmt
from mmt.core.errors import InputError
from mmt.evaluation.truth import known_texture
from mmt.testing.simulation.surfaces.model_surface import (
    ModelSurface,
    filter_side_by_side,
)
from mmt.testing.simulation.surfaces.textures import get_surface, surface_from_annotations
from mmt_bridges.hatt.models import export_hatt

FREQUENCIES_HZ = np.arange(501.0)


def test_at_a_models_point_the_texture_is_its_filter_and_between_them_the_mean():
    model = odd_model()
    surface = ModelSurface("x", model)
    inputs = model.samples.inputs[4]
    np.testing.assert_allclose(
        surface.spectrum(*inputs, FREQUENCIES_HZ)[0],
        model.spectrum(*inputs, frequencies_hz=FREQUENCIES_HZ),
        rtol=1e-9,
    )
    slow = odd_model(fastest_mm_s=100.0)  # its range becomes that of a session
    speed, force = slow.samples.inputs[2]
    np.testing.assert_allclose(
        ModelSurface("x", slow).spectrum(3.0 * speed, force, FREQUENCIES_HZ)[0],
        slow.spectrum(speed, force, frequencies_hz=FREQUENCIES_HZ),
        rtol=1e-9,
    )
    corners, weights = surface.weights(np.array([[0.4, 0.5]]))
    ends = [surface.points[c] * model.space.scale for c in corners[0]]
    mean = sum(
        w * surface.spectrum(*end, FREQUENCIES_HZ) for w, end in zip(weights[0], ends, strict=True)
    )
    np.testing.assert_allclose(surface.spectrum(120.0, 1.5, FREQUENCIES_HZ), mean, rtol=1e-6)


@pytest.mark.parametrize("suffix", [".npz", ".xml"])
def test_a_file_is_a_surface_whose_truth_travels_with_the_session(tmp_path, suffix):
    model, path = odd_model(), tmp_path / f"stone{suffix}"
    path.write_bytes(model.to_bytes() if suffix == ".npz" else export_hatt(model, "stone", 0.45))
    out = tmp_path / "a.mcap"
    output_of("session", "simulate", out, "--surface", path, "--duration", 12)
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
        (tmp_path / name).write_bytes(odd_model().to_bytes())
    (tmp_path / "readme.txt").write_text("no model")
    folder, one = str(tmp_path), str(tmp_path / "b.npz")
    assert chosen_textures(f"wood, {folder}") == ["wood", str(tmp_path / "a.npz"), one]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no model"):
        chosen_textures(str(tmp_path / "empty"))
