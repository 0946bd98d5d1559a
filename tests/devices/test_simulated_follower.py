"""The whole follower: frames, determinism, truth, and what it does not import."""

import subprocess
import sys
import time

import numpy as np
import pytest
from scipy import signal

from mmt.core.errors import InputError
from mmt.core.frames import CHANNELS, frame_dtype
from mmt.scene import Scene, Simulated
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.follower import SimulatedFollower
from mmt.testing.simulation.instruments import Instruments
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.robot import TipState
from mmt.testing.simulation.surfaces.known_surfaces import surface_from_annotations
from mmt.testing.simulation.surfaces.textures import get_surface

LINKED = {"link": {}, "hand": {}, "texture": {}}


def _follower(seed=1, channels=CHANNELS, **table):
    simulated = Simulated(**table)
    surface = get_surface(simulated.surface)
    return SimulatedFollower(simulated, channels=channels, seed=seed, surface=surface)


def _path(count):
    ticks = np.arange(count) * 1e-3
    x, y = 30.0 * np.sin(2 * np.pi * ticks), 10.0 * np.sin(3 * ticks)
    return [(float(a), float(b), -1.0) for a, b in zip(x, y, strict=True)]


def test_frames_count_time_and_sequence():
    follower = _follower()
    follower.start(5_000_000_000)
    blocks = [follower.step(n, 0, None) for n in (1, 3, 1, 7)]
    assert [len(block) for block in blocks] == [1, 3, 1, 7]
    frames = np.concatenate(blocks)
    np.testing.assert_array_equal(frames["sequence"], np.arange(12))
    np.testing.assert_array_equal(frames["time_ns"], 5_000_000_000 + np.arange(12) * 1_000_000)
    assert frames.dtype == frame_dtype()


def test_seed_decides_every_number():
    def run(seed):
        follower = _follower(seed=seed)
        return np.concatenate([follower.step(1, 0, command) for command in _path(400)])

    assert run(1).tobytes() == run(1).tobytes()
    for field in ("force_n", "acceleration_m_s2"):
        assert not np.array_equal(run(1)[field], run(2)[field])


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
    for command in _path(50):
        part, whole = some.step(2, 0, command), every.step(2, 0, command)
        assert part.dtype == frame_dtype(channels)
        for field in part.dtype.names:
            np.testing.assert_array_equal(part[field], whole[field])


def test_vibration_along_the_heading_is_a_share_and_none_across():
    surface = get_surface("sandpaper")
    instruments = Instruments(surface, CHANNELS, 3, noise=False)
    tip = TipState((0.0, 0.0, -0.3), (90.0, 120.0, 0.0), (0.0, 0.0, 1.5), (0.0, 0.0, 0.0))
    acceleration = instruments.frames([tip] * 20_000)["acceleration_m_s2"].astype(float)
    changes = np.diff(acceleration, axis=0)
    along = changes[:, :2] @ [0.6, 0.8]
    across = changes[:, :2] @ [-0.8, 0.6]
    assert along.std() / changes[:, 2].std() == pytest.approx(surface.tangential_share, rel=0.05)
    assert across.std() < 0.001 * along.std()
    assert abs(np.corrcoef(along, changes[:, 2])[0, 1]) < 0.05


def test_annotations_describe_the_surface():
    follower = _follower(surface="wood")
    assert surface_from_annotations(follower.annotations) == get_surface("wood")
    assert "wood" in follower.describe()
    follower.close()
    follower.close()


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
    assert surface_from_annotations(annotations).name == "wood"
    assert simulate_session(scene)[0].tobytes() == frames.tobytes()
    with pytest.raises(InputError, match="duration_s"):
        simulate_session(scene, duration_s=0.0)


def test_force_feedback_in_the_scene_reaches_the_hand():
    tables = {**LINKED, "session": {"duration_s": 6.0}, "simulated": {"noise": False}}
    without, _ = simulate_session(scene_from_tables(tables))
    felt, _ = simulate_session(scene_from_tables({**tables, "force_feedback": {}}))
    assert not np.array_equal(without["position_mm"][:, 2], felt["position_mm"][:, 2])
    np.testing.assert_allclose(
        without["force_n"][:, 2].mean(), felt["force_n"][:, 2].mean(), rtol=0.05
    )


def test_a_tick_is_cheap():
    started = time.perf_counter()
    simulate_session(Scene(), duration_s=3.0)
    assert time.perf_counter() - started < 3.0


def test_a_simulated_follower_stays_small():
    code = (
        "import sys, psutil\n"
        "from mmt.scene import Simulated\n"
        "from mmt.testing.simulation.follower import SimulatedFollower\n"
        "from mmt.testing.simulation.surfaces.textures import get_surface\n"
        "import mmt.testing.simulation.offline, mmt.testing.simulation.actuator\n"
        "made = {'channels': ('force',), 'seed': 1, 'surface': get_surface('plastic')}\n"
        "SimulatedFollower(Simulated(), **made).step(100, 0, None)\n"
        "assert not {'numba', 'scipy'} & set(sys.modules), 'too much is imported'\n"
        "print(psutil.Process().memory_info().rss)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=150
    )
    assert int(done.stdout) < 120 * 2**20
