"""Known textures, grained ones too: the truth against realisations and closed forms."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_surface_samples import odd_model, realisation, stroke_towards
from scipy import signal

import mmt
from mmt.core.errors import InputError
from mmt.testing.simulation.instruments import Instruments
from mmt.testing.simulation.robot import TipState
from mmt.testing.simulation.surfaces.known_surfaces import Stroke
from mmt.testing.simulation.surfaces.model_surface import ModelSurface
from mmt.testing.simulation.surfaces.modes import Grain, Line, Resonance
from mmt.testing.simulation.surfaces.surface import HIGH_PASS_POLE, Surface
from mmt.testing.simulation.surfaces.textures import (
    CORDUROY,
    GRAINED,
    SURFACES,
    get_surface,
    surface_from_annotations,
)

NAMES = sorted(name for name, surface in SURFACES.items() if surface.isotropic)


def surface_of(name, samples):
    """Return a surface by its name, or of a model, one by default that no texture has."""
    if not name.startswith("model "):
        return get_surface(name, 1000.0 * samples)
    kind = name.removeprefix("model ")
    model = mmt.load_model("felt") if kind == "felt" else odd_model(kind)
    return ModelSurface("x", model, rate_hz=1000.0 * samples)


@pytest.mark.parametrize(
    ("name", "speed", "force", "heading_deg", "samples"),
    [
        *[(name, 60.0, 0.6, 0.0, 1) for name in NAMES],
        *[(name, 220.0, 2.2, 0.0, 1) for name in NAMES],
        ("canvas", 180.0, 1.5, 20.0, 1),
        ("corduroy", 180.0, 1.5, 200.0, 1),
        ("plastic", 150.0, 1.4, 53.0, 2),
        ("oak", 150.0, 1.4, 53.0, 5),
        ("glass", 150.0, 1.4, 53.0, 10),
        ("drawn-2", 150.0, 1.4, 53.0, 5),
        ("fabric+bursts", 150.0, 1.4, 53.0, 3),
        *[(f"drawn-{seed}", 60.0, 0.6, 17.0, 1) for seed in (0, 1, 2, 3, 5, 8)],
        *[(f"drawn-{seed}", 220.0, 2.2, 115.0, 1) for seed in (0, 1, 2, 3, 5, 8)],
        ("model isotropic", 110.0, 1.3, 0.0, 1),
        ("model felt", 110.0, 1.3, 0.0, 5),
        ("model anisotropic", 110.0, 1.3, -115.0, 1),
    ],
)
def test_spectrum_is_that_of_long_realisations(name, speed, force, heading_deg, samples):
    surface = surface_of(name, samples)
    normal, along = realisation(surface, stroke_towards(speed, force, heading_deg), 50_000).T
    if getattr(surface, "patches", None) is not None:
        normal, along = np.array([normal, along]) / surface.patches.gains()[0][0]
    frequencies, measured = signal.welch(normal, 1000.0 * samples, nperseg=2048)
    heading = None if surface.isotropic else np.radians(heading_deg)
    expected = surface.spectrum(speed, force, frequencies, heading)[0]
    bands = (frequencies[1:-1] // (25.0 * samples)).astype(int)
    power, truth = (np.bincount(bands, each[1:-1]) for each in (measured, expected))
    np.testing.assert_allclose(power, truth, rtol=0.2, atol=0.004 * truth.sum())
    total = surface.power(speed, force, heading)[0]
    assert normal.var() == pytest.approx(total, rel=0.1)
    assert along.var() == pytest.approx(surface.tangential_share**2 * total, rel=0.1)
    assert abs(np.corrcoef(normal, along)[0, 1]) < 0.06


@pytest.mark.parametrize("name", NAMES)
def test_power_is_the_energy_of_the_impulse_responses(name):
    surface = get_surface(name)
    for speed, force in ((20.0, 0.2), (150.0, 1.5), (300.0, 3.0)):
        energy = 0.0
        impulse = np.zeros(8000)
        impulse[0] = 1.0
        for mode in surface.modes:
            power, frequency, bandwidth = mode.maps(speed, force)
            pole = np.exp(2j * np.pi * frequency / 1000 - np.pi * bandwidth / 1000)
            response = signal.lfilter([1.0], [1.0, -pole], impulse)
            unit = power / np.sum(np.abs(response) ** 2)
            scale = 0.5 * (1 + HIGH_PASS_POLE)
            passed = signal.lfilter([scale, -scale], [1.0, -HIGH_PASS_POLE], response)
            energy += unit * np.sum(np.abs(passed) ** 2)
        assert surface.power(speed, force)[0] == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize("name", ["model isotropic", "model anisotropic", "drawn-4", "mesh+bursts"])
def test_power_is_the_integral_of_the_spectrum(name):
    surface = surface_of(name, 1)
    stroke = [40.0, 130.0, 299.0], [0.2, 1.7, 2.9]
    fine = np.linspace(0.0, 500.0, 40_001)
    density = surface.spectrum(*stroke, fine, 0.7)
    np.testing.assert_allclose(
        np.trapezoid(density, fine, axis=1), surface.power(*stroke, 0.7), rtol=2e-3
    )


@pytest.mark.parametrize("name", NAMES)
def test_no_vibration_without_motion_or_contact(name):
    surface = get_surface(name)
    assert surface.power([0.0, 0.0, 100.0, -5.0, 100.0], [0.0, 1.0, 0.0, 1.0, -1.0]).max() == 0.0
    vibration = surface.vibration(np.random.default_rng(1))
    for _ in range(500):
        vibration.step(Stroke(150.0, 1.5))
    rest = [vibration.step(Stroke(0.0, 1.5)) for _ in range(3000)]
    assert np.abs(rest[-100:]).max() < 1e-9


@pytest.mark.parametrize("stroke", [(0.0, 0.0), (1e9, 1e9), (300.0, 0.0)])
@pytest.mark.parametrize("name", ["drawn-3+patches+bursts", "model isotropic"])
def test_at_the_ends_of_the_plane_it_stays_finite(name, stroke):
    surface = surface_of(name, 1)
    assert np.isfinite(surface.spectrum(*stroke, np.arange(500.0), 0.0)).all()
    source, far = surface.vibration(np.random.default_rng(1)), (-1e4, 1e4)
    assert np.isfinite([source.step(Stroke(*stroke, (0.0, 1.0), far)) for _ in range(300)]).all()


def test_lines_follow_speed_over_period_and_fade_before_half_the_rate():
    surface, grid = get_surface("mesh"), np.linspace(5.0, 495.0, 4901)
    period = max(mode.period_mm for mode in surface.modes if isinstance(mode, Line))
    for speed in (120.0, 180.0, 240.0):
        density = surface.spectrum(speed, 1.0, grid)[0]
        assert grid[np.argmax(density)] == pytest.approx(speed / period, rel=0.03)
    shifted = Resonance(1.0, 1.0, 1.0, 100.0, 20.0, speed_shift_hz=50.0, force_shift_hz=-20.0)
    assert shifted.maps(150.0, 1.0) == pytest.approx((1.5, 115.0, 20.0))
    line = Surface("line", (Line(1.0, 0.0, 1.0, 0.5, 0.05),))
    below, near, beyond = line.power([150.0, 230.0, 400.0], 1.0)
    assert below == pytest.approx(1.0, rel=0.02)
    assert near < 0.2
    assert beyond < 1e-5


@given(st.sampled_from(NAMES), st.floats(0.0, 2000.0), st.floats(0.0, 50.0))
def test_maps_stay_within_bounds(name, speed, force):
    for mode in SURFACES[name].modes:
        power, frequency, bandwidth = mode.maps(speed, force)
        assert 0.0 <= power < np.inf
        assert 0.0 <= frequency <= 480.0
        assert bandwidth > 0.0
        together = mode.maps(np.array([speed]), np.array([force]))
        np.testing.assert_allclose(np.ravel(together), [power, frequency, bandwidth], rtol=1e-12)


@settings(max_examples=20)
@given(st.sampled_from(NAMES), st.integers(0, 1000))
def test_generator_stays_bounded_under_erratic_hands(name, seed):
    surface = SURFACES[name]
    random = np.random.default_rng(seed)
    vibration = surface.vibration(random)
    strokes = zip(random.uniform(0, 300, 500), random.uniform(0, 3, 500), strict=True)
    values = np.array([vibration.step(Stroke(float(v), float(f))) for v, f in strokes])
    largest = sum(mode.maps(300.0, 3.0)[0] for mode in surface.modes)
    assert np.abs(values).max() < 8.0 * np.sqrt(largest)


@pytest.mark.parametrize("rate_hz", [1000.0, 5000.0])
@pytest.mark.parametrize(
    "name", [*SURFACES, "drawn-4", "drawn-11", "oak+patches-2+bursts", "drawn-2+patches"]
)
def test_the_truth_travels_with_a_session(name, rate_hz):
    surface = get_surface(name, rate_hz)
    again = surface_from_annotations(surface.annotations())
    for key in ("name", "rate_hz", "isotropic", "friction_coefficient", "patches", "bursts"):
        assert getattr(again, key, None) == getattr(surface, key, None)
    stroke = [50.0, 200.0], [0.5, 2.0], np.arange(0.0, 500.0, 10.0), 0.4
    np.testing.assert_allclose(again.spectrum(*stroke), surface.spectrum(*stroke))
    truth = json.loads(surface.annotations())
    if name in SURFACES and rate_hz == 1000.0:  # earlier readers know these
        assert truth["version"] == (1 if surface.isotropic else 2)


@pytest.mark.parametrize(
    "annotations",
    [
        b"",
        b"\xff\x00",
        b"[1, 2]",
        b'{"surface": "plastic"}',
        b'{"surface": "plastic", "version": 9, "parameters": {}}',
        b'{"surface": "a", "version": 1, "parameters": {"modes": [{"kind": "drum"}]}}',
    ],
)
def test_foreign_annotations_are_refused(annotations):
    with pytest.raises(InputError, match="annotations"):
        surface_from_annotations(annotations)


@given(
    st.floats(0.0, 360.0),
    st.floats(0.05, 1.0),
    st.floats(-0.9, 0.9),
    st.floats(-np.pi, np.pi),
    st.floats(0.0, 400.0),
)
def test_a_part_is_the_isotropic_one_at_the_speed_that_it_hears(
    across_deg, along, nap, heading, speed
):
    parts = (120.0, 60.0, 80.0), (1.7, 0.08)
    angle = heading - np.radians(across_deg)
    heard = np.hypot(speed * np.cos(angle), along * speed * np.sin(angle))
    factor = 1.0 + nap * np.cos(angle)
    grain = Grain(across_deg, along, nap)
    for grained, plain in (
        (Resonance(1.0, 1.2, 0.7, *parts[0], grain=grain), Resonance(1.0, 1.2, 0.7, *parts[0])),
        (Line(1.0, 0.8, 0.7, *parts[1], grain=grain), Line(1.0, 0.8, 0.7, *parts[1])),
    ):
        found = Surface("one", (grained,)).spectrum(speed, 1.3, [40.0, 130.0], heading)
        expected = factor * Surface("one", (plain,)).spectrum(heard, 1.3, [40.0, 130.0])
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("name", [s.name for s in GRAINED if not s.isotropic])
def test_spectrum_is_smooth_in_heading_and_depends_on_it(name):
    """A kink would keep the second difference proportional to the step, not to its square."""
    surface = SURFACES[name]
    headings, frequencies_hz = np.linspace(0.0, 2.0 * np.pi, 721), np.linspace(5.0, 495.0, 50)

    def bend(step):
        left, here, right = (
            np.log(surface.spectrum(150.0, 1.5, frequencies_hz, headings + shift))
            for shift in (-step, 0.0, step)
        )
        return np.abs(left - 2.0 * here + right).max()

    assert bend(0.001) < 0.3 * bend(0.002)
    shapes = np.sqrt(surface.spectrum(150.0, 1.5, frequencies_hz, headings))
    shapes /= np.linalg.norm(shapes, axis=1, keepdims=True)
    assert (shapes @ shapes.T).min() < 0.99
    assert np.ptp(10.0 * np.log10(surface.power(150.0, 1.5, headings[::30]))) > 1.0


@pytest.mark.parametrize("name", [s.name for s in GRAINED])
def test_only_a_nap_tells_to_from_fro(name):
    surface = SURFACES[name]
    headings = np.linspace(0.0, np.pi, 7)
    to, fro = (surface.power(150.0, 1.5, headings + turn) for turn in (0.0, np.pi))
    napped = surface.name in {"corduroy", "sawn-wood"}
    assert np.allclose(to, fro, rtol=1e-9) == (not napped)


def test_a_grain_out_of_range_is_refused():
    truth = json.loads(CORDUROY.annotations())
    truth["parameters"]["modes"][0]["grain"]["along"] = 0.0
    with pytest.raises(InputError, match="along is 0"):
        surface_from_annotations(json.dumps(truth).encode())
    with pytest.raises(InputError, match="nap 1"):
        Grain(0.0, 0.5, 1.0)


def test_the_heading_matters_to_directed_textures_alone():
    with pytest.raises(InputError, match="corduroy depends on the stroke's heading"):
        CORDUROY.spectrum(100.0, 1.0, [100.0])
    one, other = (get_surface("mesh").vibration(np.random.default_rng(5)) for _ in range(2))
    for angle in np.random.default_rng(6).uniform(0.0, 7.0, 300).tolist():
        stroke = Stroke(120.0, 1.0)
        turned = stroke._replace(heading=(np.cos(angle), np.sin(angle)))
        assert one.step(stroke) == other.step(turned)  # to the bit


@pytest.mark.parametrize("noise", [True, False])
def test_sensors_feel_the_heading_of_the_stroke_and_vibration_along_it_as_a_share(noise):
    surface = Surface("one", (Resonance(4.0, 1.0, 1.0, 150.0, 80.0, grain=Grain(90.0, 0.1)),))

    def felt(u, v):
        tip = TipState((0.0, 0.0, 0.0), (u, v, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        frames = Instruments(surface, ("acceleration",), 1, noise=noise).frames([tip] * 8000)
        return np.diff(frames["acceleration_m_s2"][1000:].astype(float), axis=0)

    across, along = felt(0.0, 100.0), felt(-100.0, 0.0)
    expected = [surface.power(100.0, 1.0, heading)[0] for heading in (np.pi / 2, np.pi)]
    ratio = across[:, 2].var() / along[:, 2].var()
    assert ratio == pytest.approx(expected[0] / expected[1], rel=0.35)
    assert ratio > 7.0
    if not noise:
        shares = across.std(axis=0) / across[:, 2].std()
        assert shares == pytest.approx((0.0, surface.tangential_share, 1.0), rel=0.05, abs=2e-3)
