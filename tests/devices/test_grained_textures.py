"""Known textures that depend on the heading: against formulae, realisations, and themselves."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.testing.simulation.instruments import Instruments
from mmt.testing.simulation.robot import TipState
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations
from mmt.testing.simulation.surfaces.modes import Grain, Line, Resonance
from mmt.testing.simulation.surfaces.surface import Surface
from mmt.testing.simulation.surfaces.textures import (
    CORDUROY,
    GRAINED,
    RIDGED_PLASTIC,
    SURFACES,
    get_surface,
)
from mmt.testing.simulation.surfaces.vibration import Stroke, SurfaceVibration

FREQUENCIES_HZ = np.linspace(5.0, 495.0, 981)
DIRECTED = [surface for surface in GRAINED if not surface.isotropic]


def name_of(surface):
    return surface.name


def test_nine_textures_of_which_one_is_isotropic():
    assert len(GRAINED) == 9
    assert [surface.name for surface in GRAINED if surface.isotropic] == ["felt"]
    assert all(SURFACES[surface.name] is surface for surface in GRAINED)


@pytest.mark.parametrize("heading_deg", [0.0, 25.0, 60.0, 140.0, 265.0])
def test_line_has_the_period_that_the_heading_crosses(heading_deg):
    heading = np.radians(heading_deg)
    density = RIDGED_PLASTIC.spectrum(280.0, 1.0, FREQUENCIES_HZ, heading)[0]
    crossed_mm_s = 280.0 * np.hypot(np.cos(heading), 0.12 * np.sin(heading))
    found = FREQUENCIES_HZ[np.argmax(density)]
    assert found == pytest.approx(crossed_mm_s / 1.8, rel=0.03, abs=1.0)
    if abs(np.cos(heading)) > 0.4:
        assert found == pytest.approx(280.0 * abs(np.cos(heading)) / 1.8, rel=0.05)


@settings(max_examples=60)
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


@pytest.mark.parametrize("surface", DIRECTED, ids=name_of)
def test_spectrum_is_smooth_in_heading_and_depends_on_it(surface):
    """A kink would keep the second difference proportional to the step, not to its square."""
    headings = np.linspace(0.0, 2.0 * np.pi, 721)

    def bend(step):
        left, here, right = (
            np.log(surface.spectrum(150.0, 1.5, FREQUENCIES_HZ[::20], headings + shift))
            for shift in (-step, 0.0, step)
        )
        return np.abs(left - 2.0 * here + right).max()

    assert bend(0.001) < 0.3 * bend(0.002)
    shapes = np.sqrt(surface.spectrum(150.0, 1.5, FREQUENCIES_HZ, headings))
    shapes /= np.linalg.norm(shapes, axis=1, keepdims=True)
    level_db = 10.0 * np.log10(surface.power(150.0, 1.5, headings[::30]))
    assert np.ptp(level_db) > 1.0
    assert (shapes @ shapes.T).min() < 0.99


@pytest.mark.parametrize("surface", GRAINED, ids=name_of)
def test_only_a_nap_tells_to_from_fro(surface):
    headings = np.linspace(0.0, np.pi, 7)
    to, fro = (surface.power(150.0, 1.5, headings + turn) for turn in (0.0, np.pi))
    napped = any(mode.grain is not None and mode.grain.nap for mode in surface.modes)
    assert napped == (surface.name in {"corduroy", "sawn-wood"})
    assert np.allclose(to, fro, rtol=1e-9) == (not napped)


def test_the_nine_differ_from_each_other():
    headings = np.radians([5.0, 50.0, 95.0, 140.0, 275.0])
    shapes = []
    for surface in GRAINED:
        density = np.sqrt(surface.spectrum(150.0, 1.5, FREQUENCIES_HZ, headings)).ravel()
        shapes.append(density / np.linalg.norm(density))
    likeness = np.array(shapes) @ np.array(shapes).T
    assert (likeness - np.eye(9)).max() < 0.97


def test_annotations_of_isotropic_textures_know_nothing_of_grains():
    assert b"grain" not in get_surface("mesh").annotations()


def test_a_grain_out_of_range_is_refused():
    truth = json.loads(CORDUROY.annotations())
    truth["parameters"]["modes"][0]["grain"]["along"] = 0.0
    with pytest.raises(InputError, match="along is 0"):
        surface_from_annotations(json.dumps(truth).encode())
    with pytest.raises(InputError, match="nap 1"):
        Grain(0.0, 0.5, 1.0)


def test_without_a_heading_a_directed_texture_has_no_spectrum():
    with pytest.raises(InputError, match="corduroy depends on the stroke's heading"):
        CORDUROY.spectrum(100.0, 1.0, [100.0])
    felt = get_surface("felt")
    np.testing.assert_array_equal(
        felt.power([100.0], [1.0]), felt.power([100.0], [1.0], np.array([2.0]))
    )


def test_isotropic_vibration_is_the_same_to_the_bit_at_all_headings():
    one, other = (SurfaceVibration(get_surface("mesh"), np.random.default_rng(5)) for _ in range(2))
    random = np.random.default_rng(6)
    for angle in random.uniform(0.0, 7.0, 300).tolist():
        stroke = Stroke(120.0, 1.0)
        turned = stroke._replace(heading=(np.cos(angle), np.sin(angle)))
        assert one.step(stroke) == other.step(turned)


@pytest.mark.parametrize("noise", [True, False])
def test_sensors_feel_the_heading_of_the_stroke(noise):
    surface = Surface("one", (Resonance(4.0, 1.0, 1.0, 150.0, 80.0, grain=Grain(90.0, 0.1)),))

    def vibration_of(u, v):
        tip = TipState((0.0, 0.0, 0.0), (u, v, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        frames = Instruments(surface, ("acceleration",), 1, noise=noise).frames([tip] * 8000)
        return frames["acceleration_m_s2"][1000:, 2].var()

    across, along = vibration_of(0.0, 100.0), vibration_of(-100.0, 0.0)
    assert across == pytest.approx(surface.power(100.0, 1.0, np.pi / 2)[0], rel=0.15)
    assert along == pytest.approx(surface.power(100.0, 1.0, np.pi)[0], rel=0.2)
    assert across > 7.0 * along
