"""Known textures: the truth against realisations and against closed forms."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from mmt.core.errors import InputError
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations
from mmt.testing.simulation.surfaces.modes import Line, Resonance
from mmt.testing.simulation.surfaces.surface import HIGH_PASS_POLE, Surface
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface
from mmt.testing.simulation.surfaces.vibration import Stroke, SurfaceVibration

NAMES = sorted(name for name, surface in SURFACES.items() if surface.isotropic)


def _realisation(surface, speed, force, heading, count, seed=3):
    vibration = SurfaceVibration(surface, np.random.default_rng(seed))
    towards = (float(np.cos(heading)), float(np.sin(heading)))
    samples = np.array([vibration.step(Stroke(speed, force, towards)) for _ in range(count + 2000)])
    return samples[2000:]


@pytest.mark.parametrize(
    ("name", "speed", "force", "heading_deg"),
    [
        *[(name, 60.0, 0.6, 0.0) for name in NAMES],
        *[(name, 220.0, 2.2, 0.0) for name in NAMES],
        ("canvas", 180.0, 1.5, 20.0),
        ("corduroy", 180.0, 1.5, 200.0),
    ],
)
def test_spectrum_is_that_of_long_realisations(name, speed, force, heading_deg):
    surface = get_surface(name)
    heading = np.radians(heading_deg)
    normal, along = _realisation(surface, speed, force, heading, 50_000).T
    frequencies, measured = signal.welch(normal, 1000.0, nperseg=2048)
    expected = surface.spectrum(speed, force, frequencies, heading)[0]
    bands = (frequencies[1:-1] // 25.0).astype(int)
    power = np.bincount(bands, measured[1:-1])
    truth = np.bincount(bands, expected[1:-1])
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


@pytest.mark.parametrize("name", NAMES)
def test_no_vibration_without_motion_or_contact(name):
    surface = get_surface(name)
    assert surface.power([0.0, 0.0, 100.0, -5.0, 100.0], [0.0, 1.0, 0.0, 1.0, -1.0]).max() == 0.0
    vibration = SurfaceVibration(surface, np.random.default_rng(1))
    for _ in range(500):
        vibration.step(Stroke(150.0, 1.5))
    rest = [vibration.step(Stroke(0.0, 1.5)) for _ in range(3000)]
    assert np.abs(rest[-100:]).max() < 1e-9


@pytest.mark.parametrize("name", SURFACES)
def test_level_is_realistic_and_rises_at_all_headings(name):
    surface = get_surface(name)
    headings = np.linspace(0.0, 2.0 * np.pi, 13)
    low, middle, high = (
        np.sqrt(surface.power(speed, force, headings))
        for speed, force in ((40.0, 0.4), (150.0, 1.5), (300.0, 3.0))
    )
    assert (low < middle).all()
    assert (middle < high).all()
    assert high.max() < 15.0
    assert middle.min() > 0.1
    if surface.isotropic:
        slow, fast = surface.power([100.0, 200.0], [1.0, 1.0])
        assert 0.7 < np.log2(fast / slow) < (2.3 if name == "rubber" else 1.5)


def test_textures_differ_in_kind():
    grid = np.linspace(5.0, 495.0, 99)
    shapes = {}
    for name in NAMES:
        density = np.sqrt(SURFACES[name].spectrum(150.0, 1.5, grid)[0])
        shapes[name] = density / np.linalg.norm(density)
    rms = {name: float(np.sqrt(SURFACES[name].power(150.0, 1.5)[0])) for name in NAMES}
    for first in NAMES:
        for second in NAMES[: NAMES.index(first)]:
            likeness = shapes[first] @ shapes[second]
            assert likeness < 0.985 or not 0.8 < rms[first] / rms[second] < 1.25


@pytest.mark.parametrize("name", ["mesh", "ribbed"])
def test_line_follows_speed_over_period(name):
    surface = get_surface(name)
    period = max(mode.period_mm for mode in surface.modes if isinstance(mode, Line))
    grid = np.linspace(5.0, 495.0, 4901)
    for speed in (120.0, 180.0, 240.0):
        density = surface.spectrum(speed, 1.0, grid)[0]
        assert grid[np.argmax(density)] == pytest.approx(speed / period, rel=0.03)


def test_lines_fade_before_half_the_rate():
    line = Surface("line", (Line(1.0, 0.0, 1.0, 0.5, 0.05),))
    below, near, beyond = line.power([150.0, 230.0, 400.0], 1.0)
    assert below == pytest.approx(1.0, rel=0.02)
    assert near < 0.2
    assert beyond < 1e-5


@settings(max_examples=100)
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
    vibration = SurfaceVibration(surface, random)
    speeds, forces = random.uniform(0, 300, 500), random.uniform(0, 3, 500)
    values = np.array(
        [vibration.step(Stroke(float(v), float(f))) for v, f in zip(speeds, forces, strict=True)]
    )
    largest = sum(mode.maps(300.0, 3.0)[0] for mode in surface.modes)
    assert np.abs(values).max() < 8.0 * np.sqrt(largest)


@pytest.mark.parametrize("name", SURFACES)
def test_annotations_rebuild_the_surface(name):
    surface = get_surface(name)
    assert surface_from_annotations(surface.annotations()) == surface
    truth = json.loads(surface.annotations())
    assert truth["surface"] == name
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


def test_custom_surface_keeps_its_shift():
    mode = Resonance(1.0, 1.0, 1.0, 100.0, 20.0, speed_shift_hz=50.0, force_shift_hz=-20.0)
    power, frequency, bandwidth = mode.maps(150.0, 1.0)
    assert (power, frequency, bandwidth) == pytest.approx((1.5, 115.0, 20.0))
