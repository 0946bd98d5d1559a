"""A simulated follower whose acceleration is faster than its motion: texture, sensors, frames."""

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import welch

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, acceleration_samples, frame_dtype
from mmt.scene import Simulated
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.follower import SimulatedFollower
from mmt.testing.simulation.instruments import ACCELERATION_NOISE_M_S2
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import SurfaceCourse
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations, vibration_of
from mmt.testing.simulation.surfaces.surface import Surface
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface
from mmt.testing.simulation.surfaces.vibration import Stroke

NAMES = [*sorted(SURFACES), "drawn-1", "drawn-2", "drawn-7", "final-3"]
LINKED = {"link": {}, "hand": {}, "texture": {}}


def _scene(samples, *, noise=True):
    session = {"acceleration_rate_hz": 1000 * samples}
    return scene_from_tables({**LINKED, "session": session, "simulated": {"noise": noise}})


def _bands(frequencies, density, width_hz):
    return np.bincount((frequencies[1:-1] // width_hz).astype(int), density[1:-1])


@pytest.mark.parametrize(
    ("name", "samples"),
    [("plastic", 2), ("oak", 5), ("glass", 10), ("drawn-2", 5), ("fabric+bursts", 3)],
)
def test_the_truth_is_that_of_long_realisations_at_every_rate(name, samples):
    rate_hz = 1000.0 * samples
    surface = get_surface(name, rate_hz)
    source = vibration_of(surface, np.random.default_rng(4))
    stroke = Stroke(150.0, 1.4, (0.6, 0.8))
    for _ in range(300):
        source.run(samples, stroke)
    frames = [source.run(samples, stroke) for _ in range(120_000 // samples)]
    normal, along = np.concatenate(frames).T
    frequencies, measured = welch(normal, rate_hz, nperseg=2048)
    heading_rad = np.arctan2(0.8, 0.6)
    expected = surface.spectrum(150.0, 1.4, frequencies, heading_rad)[0]
    power, truth = (
        _bands(frequencies, density, 0.025 * rate_hz) for density in (measured, expected)
    )
    np.testing.assert_allclose(power, truth, rtol=0.25, atol=0.004 * truth.sum())
    total = surface.power(150.0, 1.4, heading_rad)[0]
    assert normal.var() == pytest.approx(total, rel=0.12)
    assert along.var() == pytest.approx(surface.tangential_share**2 * total, rel=0.12)


@pytest.mark.parametrize("name", NAMES)
def test_a_faster_texture_adds_bands_above_500_hz_to_the_same_parts(name):
    surfaces = [get_surface(name, 1000.0 * samples) for samples in (1, 2, 5, 10)]
    modes = [getattr(surface, "base", surface).modes for surface in surfaces]
    for slower, faster in pairwise(modes):
        assert faster[: len(slower)] == slower
        assert len(faster) > len(slower)
    for speed in (30.0, 100.0, 300.0):
        for force in (0.1, 1.0, 3.0):
            for mode in modes[-1][len(modes[0]) :]:
                frequency = mode.maps(speed, force)[1]
                assert 500.0 < frequency < 4900.0
    below_hz = np.arange(20.0, 400.0, 20.0)
    one, two, five, ten = (s.spectrum(100.0, 1.0, below_hz, 0.3)[0] for s in surfaces)
    for faster in (two, five, ten):
        # at 1 kHz the tails of the parts are folded at 500 Hz, which counts where little is
        assert np.abs(faster - one).sum() < 0.2 * one.sum()
    assert np.isfinite(surfaces[-1].spectrum(100.0, 1.0, np.arange(0.0, 5000.0, 50.0), 0.3)).all()


def test_the_bands_differ_from_texture_to_texture():
    added = [get_surface(name, 5000.0).modes[-1].frequency_hz for name in SURFACES]
    assert len(set(added)) == len(added)


@pytest.mark.parametrize("name", ["mesh", "oak", "drawn-2", "plastic+patches"])
def test_the_truth_in_a_recording_has_the_rate(name):
    surface = get_surface(name, 5000.0)
    again = surface_from_annotations(surface.annotations())
    assert again.rate_hz == 5000.0
    frequencies = np.arange(0.0, 2500.0, 100.0)
    np.testing.assert_array_equal(
        again.spectrum(120.0, 1.2, frequencies, 0.2), surface.spectrum(120.0, 1.2, frequencies, 0.2)
    )


@settings(max_examples=10)
@given(st.integers(1, 10), st.sets(st.sampled_from(CHANNELS), min_size=1), st.integers(1, 7))
def test_frames_do_not_depend_on_how_ticks_are_grouped(samples, channels, grouped):
    def follower():
        surface = get_surface("oak", 1000.0 * samples)
        return SimulatedFollower(Simulated(), channels=channels, seed=3, surface=surface)

    single, several = follower(), follower()
    path = [(30.0 * np.sin(0.03 * k), 0.15 * k, -1.0) for k in range(60)]
    one = np.concatenate([single.step(1, 0, place) for place in path for _ in range(grouped)])
    more = np.concatenate([several.step(grouped, 0, place) for place in path])
    assert one.dtype == frame_dtype(channels, samples)
    np.testing.assert_array_equal(one, more)


def test_motion_and_force_are_those_at_1_khz():
    slow, fast = (simulate_session(_scene(k), surface="plastic", duration_s=3.0)[0] for k in (1, 5))
    assert fast.dtype == frame_dtype(CHANNELS, 5)
    for field in ("sequence", "time_ns", "position_mm", "force_n"):
        np.testing.assert_array_equal(slow[field], fast[field])


def test_the_tools_own_motion_is_smooth_between_the_ticks():
    """What is left of the ticks at 1 kHz lies far below the noise of the sensor."""
    bare = Surface("bare", (), rate_hz=5000.0)
    frames, _ = simulate_session(_scene(5, noise=False), surface=bare, duration_s=6.0)
    frequencies, density = welch(acceleration_samples(frames), 5000.0, nperseg=5000, axis=0)
    noise = ACCELERATION_NOISE_M_S2**2 / 500.0
    around = (frequencies > 900.0) & (frequencies < 1100.0)
    assert density[around].max() < 0.01 * noise


@pytest.mark.parametrize("samples", [1, 5, 10])
def test_the_sensors_noise_has_the_same_density_at_every_rate(samples):
    bare = Surface("bare", (), rate_hz=1000.0 * samples)
    follower = SimulatedFollower(Simulated(), channels=["acceleration"], seed=1, surface=bare)
    values = acceleration_samples(follower.step(8000 // samples, 0, None)).astype(float)
    differences = np.diff(values, axis=0)[100:]
    deviation = ACCELERATION_NOISE_M_S2 * np.sqrt(samples)
    resolution = 2.0 * 3.6 * 9.80665 / 4096.0
    expected = np.sqrt(2.0 * (deviation**2 + resolution**2 / 12.0))
    np.testing.assert_allclose(differences.std(axis=0), expected, rtol=0.1)


def test_a_surface_of_another_rate_is_refused_with_a_sentence():
    with pytest.raises(
        InputError, match=r"surface plastic is at 1000 Hz, the scene's accel.+5000 Hz"
    ):
        simulate_session(_scene(5), surface=get_surface("plastic"), duration_s=0.1)
    with pytest.raises(InputError, match="of one rate"):
        SurfaceCourse([get_surface("plastic"), get_surface("oak", 2000.0)], [])


def test_a_course_goes_over_surfaces_of_the_scenes_rate():
    session = {"acceleration_rate_hz": 3000}
    course = {"surfaces": ["oak", "drawn-1"], "stay_s": 1.0}
    scene = scene_from_tables({**LINKED, "session": session, "simulated": {"course": course}})
    frames, annotations = simulate_session(scene, duration_s=4.0)
    assert frames.dtype == frame_dtype(CHANNELS, 3)
    rates = [
        surface_from_annotations(json.dumps(one).encode()).rate_hz
        for one in json.loads(annotations)["parameters"]["surfaces"]
    ]
    assert rates == [3000.0, 3000.0, 3000.0]
    assert np.isfinite(acceleration_samples(frames)).all()
