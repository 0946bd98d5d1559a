"""The whole simulated follower: frames at any rate, determinism, truth, and wild commands."""

import time
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, acceleration_samples, frame_dtype
from mmt.scene import Scene, Simulated
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.follower import SimulatedFollower
from mmt.testing.simulation.instruments import ACCELERATION_NOISE_M_S2
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import SurfaceCourse
from mmt.testing.simulation.surfaces.surface import Surface
from mmt.testing.simulation.surfaces.textures import SURFACES, get_surface, surface_from_annotations

LINKED = {"link": {}, "hand": {}, "texture": {}}


def _follower(seed=1, channels=CHANNELS, **table):
    simulated = Simulated(**table)
    surface = get_surface(simulated.surface)
    return SimulatedFollower(simulated, channels=channels, seed=seed, surface=surface)


def _path(count):
    ticks = np.arange(count) * 1e-3
    x, y = 30.0 * np.sin(2 * np.pi * ticks), 10.0 * np.sin(3 * ticks)
    return [(float(a), float(b), -1.0) for a, b in zip(x, y, strict=True)]


def test_waits_above_the_surface_and_holds_the_last_command():
    follower = _follower(noise=False)
    waiting = follower.step(500, 0, None)
    np.testing.assert_allclose(waiting["position_mm"], [[0.0, 0.0, 5.0]] * 500, atol=1e-6)
    assert waiting["force_n"].max() == 0.0
    follower.step(1, 0, (10.0, 5.0, 2.0))
    held = follower.step(1000, 0, None)
    np.testing.assert_allclose(held["position_mm"][-1], [10.0, 5.0, 2.0], atol=1e-4)
    assert not follower.finished


def test_wild_commands_do_no_harm():
    follower = _follower(noise=False, surface="ribbed")
    for wild in ((np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (1e30, -1e30, 1e30), (-1e300, 0.0, -1e9)):
        follower.step(20, 0, wild)
    frames = follower.step(2000, 0, (10.0, 5.0, 2.0))
    assert np.isfinite(frames["acceleration_m_s2"]).all()
    np.testing.assert_allclose(frames["position_mm"][-1], [10.0, 5.0, 2.0], atol=1e-3)


@pytest.mark.parametrize("channels", [("position",), ("force", "acceleration"), CHANNELS])
def test_only_the_scenes_channels_and_the_same_numbers(channels):
    some, every = _follower(seed=2, channels=channels), _follower(seed=2)
    some.start(5_000_000_000)
    every.start(5_000_000_000)
    for tick, command in enumerate(_path(50)):
        part, whole = some.step(2, 0, command), every.step(2, 0, command)
        assert part.dtype == frame_dtype(channels)
        assert part["sequence"].tolist() == [2 * tick, 2 * tick + 1]
        assert part["time_ns"][1] == 5_000_000_000 + (2 * tick + 1) * 1_000_000
        for field in part.dtype.names:
            np.testing.assert_array_equal(part[field], whole[field])


@pytest.mark.parametrize("name", ["plastic", "ribbed", "glass"])
def test_measured_vibration_has_the_surfaces_power(name):
    """Over a whole session, filtered power is the mean true power along the way."""
    frames, annotations = simulate_session(Scene(), name, 18.0, 11)
    position = frames["position_mm"][:, :2].astype(float)
    low_pass = signal.butter(2, 30.0, fs=1000.0, output="sos")
    velocity = np.diff(signal.sosfiltfilt(low_pass, position, axis=0), axis=0) * 1000.0
    speed = np.hypot(*velocity.T)
    force = frames["force_n"][1:, 2].astype(float)
    truth = surface_from_annotations(annotations).power(speed[::20], force[::20]).mean()
    high_pass = signal.butter(4, 15.0, "highpass", fs=1000.0, output="sos")
    vibration = signal.sosfiltfilt(high_pass, frames["acceleration_m_s2"][:, 2].astype(float))
    noise = 150e-6 * 9.80665 * np.sqrt(500.0)
    assert vibration.var() - noise**2 == pytest.approx(truth, rel=0.15)


def test_session_takes_scene_and_overrides():
    session = {"duration_s": 2.0, "seed": 6}
    scene = scene_from_tables({**LINKED, "session": session, "simulated": {"surface": "mesh"}})
    frames, annotations = simulate_session(scene)
    assert len(frames) == 2000
    assert surface_from_annotations(annotations).name == "mesh"
    other, annotations = simulate_session(scene, get_surface("wood"), 1.0, 7)
    assert len(other) == 1000
    assert surface_from_annotations(annotations) == get_surface("wood")
    assert simulate_session(scene)[0].tobytes() == frames.tobytes()
    reseeded, _ = simulate_session(scene, seed=7)
    for field in ("force_n", "acceleration_m_s2"):
        assert not np.array_equal(reseeded[field], frames[field])
    tables = {**LINKED, "session": session, "simulated": {"surface": "mesh"}, "force_feedback": {}}
    felt, _ = simulate_session(scene_from_tables(tables))
    assert not np.array_equal(felt["position_mm"], frames["position_mm"])
    with pytest.raises(InputError, match="duration_s"):
        simulate_session(scene, duration_s=0.0)


@pytest.mark.parametrize("name", [*sorted(SURFACES), "drawn-1", "drawn-2", "drawn-7", "final-3"])
def test_a_faster_texture_adds_bands_above_500_hz_to_the_same_parts(name):
    surfaces = [get_surface(name, 1000.0 * samples) for samples in (1, 2, 5, 10)]
    modes = [getattr(surface, "base", surface).modes for surface in surfaces]
    for slower, faster in pairwise(modes):
        assert faster[: len(slower)] == slower
        assert len(faster) > len(slower)
    for mode, speed, force in product(modes[-1][len(modes[0]) :], (30.0, 300.0), (0.1, 3.0)):
        assert 500.0 < mode.maps(speed, force)[1] < 4900.0
    below_hz = np.arange(20.0, 400.0, 20.0)
    one, *faster = (s.spectrum(100.0, 1.0, below_hz, 0.3)[0] for s in surfaces)
    # at 1 kHz the tails of the parts are folded at 500 Hz, which counts where little is
    assert np.abs(np.array(faster) - one).sum(axis=1).max() < 0.2 * one.sum()


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


def test_faster_frames_have_the_motion_of_those_at_1_khz_and_surfaces_of_their_rate():
    slow, fast = (
        scene_from_tables({**LINKED, "simulated": {}, "session": {"acceleration_rate_hz": rate_hz}})
        for rate_hz in (1000, 5000)
    )
    began = time.perf_counter()
    some, more = (simulate_session(scene, duration_s=3.0)[0] for scene in (slow, fast))
    assert time.perf_counter() - began < 12.0  # a tick is cheap
    assert more.dtype == frame_dtype(CHANNELS, 5)
    for field in ("sequence", "time_ns", "position_mm", "force_n"):
        np.testing.assert_array_equal(some[field], more[field])
    words = r"surface plastic is at 1000 Hz, the scene's accel.+5000 Hz"
    with pytest.raises(InputError, match=words):
        simulate_session(fast, surface=get_surface("plastic"), duration_s=0.1)
    with pytest.raises(InputError, match="of one rate"):
        SurfaceCourse([get_surface("plastic"), get_surface("oak", 2000.0)], [])
