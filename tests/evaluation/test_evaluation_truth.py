"""The comparison with a known texture, against models that are right or wrong by design."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from mmt.evaluation.model_errors import (
    GRID_FORCE_N,
    GRID_SPEED_MM_S,
    LEAST_POWER,
    Strokes,
    band_edges_hz,
    level_error_db,
    over_plane,
    power_above_felt,
)
from mmt.evaluation.truth import KnownTexture, TruthAt, known_texture
from mmt.testing.simulation.surfaces.modes import Resonance
from mmt.testing.simulation.surfaces.surface import Surface
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface
from mmt.texture.autoregression.forms import (
    ar_spectrum,
    ar_to_reflection,
    lsf_output_power,
    reflection_to_lsf,
)
from mmt.texture.model.texture_model import TextureModel, TextureSamples
from mmt.texture.settings import ModellingSettings

ORDER = 24


def exact_filters(surface, speed_mm_s, force_n, order):
    """Solve the Yule-Walker equations for the surface's exact autocorrelation."""
    frequencies_hz = np.arange(2049) * 500.0 / 2048
    density = surface.spectrum(speed_mm_s, force_n, frequencies_hz)
    correlation = np.fft.irfft(density * 500.0, axis=1)[:, : order + 1]
    lags = np.abs(np.subtract.outer(np.arange(order), np.arange(order)))
    ar = np.array([np.linalg.solve(r[lags], -r[1:]) for r in correlation])
    variance = correlation[:, 0] + np.einsum("no,no->n", ar, correlation[:, 1:])
    lsf = reflection_to_lsf(ar_to_reflection(ar))
    return TextureSamples.isotropic(speed_mm_s, force_n, lsf, variance, correlation[:, 0])


def model_of(surface, speeds=GRID_SPEED_MM_S, forces=GRID_FORCE_N, *, order=ORDER, level=1.0):
    speed, force = np.meshgrid(speeds, forces)
    made = exact_filters(surface, speed.ravel(), force.ravel(), order)
    louder = replace(made, variance=level * made.variance, power=level * made.power)
    return TextureModel(louder, method="published")


def resonant_model(rate_hz):
    """Return a model of a resonance at 150 Hz and one at a third of the rate, the same anywhere."""
    ar = np.ones(1)
    for frequency_hz, bandwidth_hz in ((150.0, 60.0), (rate_hz / 3.0, rate_hz / 10.0)):
        radius = np.exp(-np.pi * bandwidth_hz / rate_hz)
        turn = np.cos(2.0 * np.pi * frequency_hz / rate_hz)
        ar = np.convolve(ar, [1.0, -2.0 * radius * turn, radius**2])
    lsf = np.tile(reflection_to_lsf(ar_to_reflection(ar[1:])), (GRID_FORCE_N.size, 1))
    level = np.full(len(lsf), 100.0)
    samples = TextureSamples.isotropic(GRID_SPEED_MM_S, GRID_FORCE_N, lsf, level, level)
    return TextureModel(samples, method="published", rate_hz=rate_hz)


@pytest.mark.parametrize("rate_hz", [1000.0, 2000.0, 5000.0, 10000.0])
def test_at_any_rate_a_model_has_no_error_against_its_own_spectrum(rate_hz):
    model = resonant_model(rate_hz)
    strokes = over_plane()
    inputs = strokes.inputs(model.space)
    truth = TruthAt(strokes, lambda at: model.spectrum(*inputs.T, frequencies_hz=at), rate_hz)
    errors = truth.errors(model)
    assert errors.bands_db.shape == (144, len(band_edges_hz(rate_hz)) - 1)
    for error_db in (errors.bands_db, errors.log_spectral_db, 1.0 - errors.gfc):
        np.testing.assert_allclose(error_db, 0.0, atol=1e-6)
    np.testing.assert_allclose(errors.power_error_db, 0.0, atol=0.02)
    np.testing.assert_allclose(truth.level_errors_db(model), errors.power_error_db, atol=1e-9)
    np.testing.assert_allclose(level_error_db(model, inputs, truth.power), 0.0, atol=0.1)


@pytest.mark.parametrize("rate_hz", [5000.0, 10000.0])
def test_what_is_not_felt_counts_by_bands_and_not_for_the_level(rate_hz):
    model, strokes = resonant_model(rate_hz), over_plane()
    inputs = strokes.inputs(model.space)

    def louder_above(frequencies_hz, gain):
        density = model.spectrum(*inputs.T, frequencies_hz=frequencies_hz)
        return np.where(frequencies_hz > 1000.0, gain, 1.0) * density

    own, other = (
        TruthAt(strokes, partial(louder_above, gain=gain), rate_hz).errors(model)
        for gain in (1.0, 4.0)
    )
    np.testing.assert_allclose(own.power_error_db, other.power_error_db, atol=1e-9)
    above = band_edges_hz(rate_hz)[:-1] > 1000.0
    np.testing.assert_allclose(other.bands_db[:, above], -6.0206, atol=1e-3)


@pytest.mark.parametrize("name", [*(n for n, s in SURFACES.items() if s.isotropic), "pine"])
def test_true_power_is_that_of_the_surface(name):
    surface = get_surface(name)
    truth = KnownTexture(surface)
    model = model_of(get_surface("plastic"), order=8)
    speed, force, heading = truth.plane.strokes
    low_hz = np.linspace(0.0, 8.0, 401)
    lsf, variance = model.at(speed, force)
    own = model.spectrum(speed, force, frequencies_hz=low_hz)
    own_power = lsf_output_power(variance, lsf) - np.trapezoid(own, low_hz, axis=1)
    true = surface.spectrum(speed, force, low_hz, heading)
    true_power = surface.power(speed, force, heading) - np.trapezoid(true, low_hz, axis=1)
    expected = 10.0 * np.log10(own_power / true_power)
    np.testing.assert_allclose(truth.plane.errors(model).power_error_db, expected, atol=0.02)


def test_dft321_adds_the_tangential_power():
    surface = Surface("made", (Resonance(1.0, 1.0, 1.0, 120.0, 80.0),), tangential_share=0.5)
    normal, _ = known_texture(surface.annotations(), ModellingSettings())
    all_axes, _ = known_texture(surface.annotations(), ModellingSettings(axis="dft321"))
    point = Strokes(*np.array([[100.0], [1.0], [0.0]])), np.array([120.0])
    np.testing.assert_allclose(all_axes.spectrum(*point), 1.25 * normal.spectrum(*point))


@pytest.mark.parametrize(
    ("annotations", "settings", "said"),
    [
        (b"", ModellingSettings(), "no known texture"),
        (b"{}", ModellingSettings(), "no simulated truth"),
        (get_surface("wood").annotations(), ModellingSettings(axis="x"), "wood"),
        (get_surface("wood").annotations(), ModellingSettings(normal="y"), "normal y"),
    ],
)
def test_without_a_usable_truth_the_reason_is_said(annotations, settings, said):
    truth, reason = known_texture(annotations, settings)
    assert truth is None
    assert said in reason


def worst_of(model, surface):
    truth = KnownTexture(surface)
    errors = truth.plane.errors(model)
    return errors, truth.worst(model, errors)


def test_worst_points_are_the_extremes_of_the_grid():
    ribbed = get_surface("ribbed")
    model = model_of(ribbed, np.array([100.0, 220.0]), np.array([0.8, 2.0]))
    errors, (level, shape) = worst_of(model, ribbed)
    assert (level.measure, shape.measure) == ("power", "gfc")
    assert abs(level.power_error_db) == np.abs(errors.power_error_db).max()
    assert shape.gfc == errors.gfc.min()


def test_worst_beyond_the_samples():
    """The level of a field says how sure it is there."""
    slow = model_of(get_surface("plastic"), np.array([40.0, 60.0]), np.array([0.3, 0.6]))
    _, (level, _) = worst_of(slow, get_surface("plastic"))
    assert level.limit == "beyond the samples"
    assert level.boundary_share >= 0.5
    assert level.speed_mm_s > 200
    assert level.force_n > 2
    field = TextureModel(slow.samples)
    _, (level, shape) = worst_of(field, get_surface("plastic"))
    assert level.limit == "field"
    _, deviation_db = field.level_db(level.speed_mm_s, level.force_n)
    assert f"right to {deviation_db[0]:.1f} dB" in level.reason
    assert shape.limit != "field"


def test_worst_fit_where_the_samples_themselves_are_wrong():
    ribbed = get_surface("ribbed")
    _, (level, shape) = worst_of(model_of(ribbed, order=2, level=4.0), ribbed)
    assert level.limit == shape.limit == "fit"
    assert "mm/s" in level.reason


def test_worst_interpolation_where_the_samples_are_right():
    surface = get_surface("ribbed")
    speeds = np.linspace(15.0, 290.0, 12)
    _, (_, shape) = worst_of(model_of(surface, speeds, GRID_FORCE_N, order=40), surface)
    assert shape.limit == "interpolation"
    assert shape.nearest_sample < 0.2


def test_worst_sparse_where_the_samples_are_far():
    surface = Surface("peak", (Resonance(1.0, 0.0, 0.0, 60.0, 20.0, speed_shift_hz=400.0),))
    axes = np.meshgrid(np.linspace(10.0, 290.0, 15), np.linspace(0.1, 2.9, 15))
    speed, force = (axis.ravel() for axis in axes)
    ring = (speed < 40) | (speed > 260) | (force < 0.4) | (force > 2.6)
    model = TextureModel(exact_filters(surface, speed[ring], force[ring], 8), method="published")
    _, (_, shape) = worst_of(model, surface)
    assert shape.limit == "sparse"
    assert shape.nearest_sample > 0.2


def test_what_nobody_feels_counts_as_silence():
    silent = model_of(get_surface("wood"), level=0.0)
    truth = KnownTexture(get_surface("wood"))
    errors = truth.plane.errors(silent)
    floor_db = 10.0 * np.log10(LEAST_POWER / truth.plane.power)
    np.testing.assert_allclose(errors.power_error_db, floor_db)
    assert (errors.gfc == 0.0).all()
    quiet = Surface("quiet", (Resonance(1e-30, 0.0, 0.0, 120.0, 80.0),))
    assert (KnownTexture(quiet).plane.errors(silent).power_error_db == 0.0).all()
    loud = Surface("loud", (Resonance(1e6, 0.0, 0.0, 120.0, 80.0),))
    assert (KnownTexture(loud).plane.errors(silent).power_error_db == -60.0).all()


@pytest.mark.parametrize("tone_hz", [40.0, 700.0, 1800.0, 3999.7])
@pytest.mark.parametrize("radius", [0.9, 0.99, 0.9999])
def test_what_is_not_felt_of_a_tone_in_noise_is_the_part_above_1_khz(tone_hz, radius):
    rate_hz = 10_000.0
    ar = np.array([[-2.0 * radius * np.cos(2.0 * np.pi * tone_hz / rate_hz), radius**2]])
    frequencies_hz = np.linspace(0.0, rate_hz / 2.0, 2_000_001)
    density = ar_spectrum(ar[0], 1.0, frequencies_hz, rate_hz)
    felt = frequencies_hz <= 1000.0
    whole, above = (
        np.trapezoid(density[part], frequencies_hz[part]) for part in (felt | True, ~felt)
    )
    (found,) = power_above_felt(ar, np.array([whole]), rate_hz)
    assert 0.0 <= found <= whole
    assert found / whole == pytest.approx(above / whole, abs=0.01)


def test_at_1_khz_everything_is_felt():
    assert power_above_felt(np.array([[-0.9]]), np.array([2.0]), 1000.0).tolist() == [0.0]
