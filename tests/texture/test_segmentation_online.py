"""Online segmentation against one pass with everything known, on strokes as hands make them."""

from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from test_segmentation import online, ranges

from mmt.core.frames import empty_frames
from mmt.texture.segmentation.segmenter import segment
from mmt.texture.signals.filtering import StreamFilter

RATE_HZ = 1000.0
RECORDED = Path(__file__).parents[2] / "../shared/data/bilateral_1dof"


def wander(generator, count, corner_hz):
    """Noise of unit deviation that changes no faster than a hand."""
    pole = np.exp(-2.0 * np.pi * corner_hz / RATE_HZ)
    poles = np.poly([pole, pole])
    raw = scipy.signal.lfilter([1.0], poles, generator.normal(size=count + 4000))[4000:]
    return raw / raw.std()


def as_measured(generator, speed_mm_s, force_n, heading):
    """Encoders of 0.03 mm, 5 mN of force noise, filtered as online."""
    count = len(speed_mm_s)
    frames = empty_frames(count)
    frames["sequence"] = np.arange(count)
    path_mm = np.cumsum(speed_mm_s[:, None] * np.c_[np.cos(heading), np.sin(heading)], axis=0)
    position_mm = np.c_[path_mm / RATE_HZ, -force_n / 5.0]
    frames["position_mm"] = 0.03 * np.round(position_mm / 0.03)
    frames["force_n"][:, 2] = force_n
    frames["force_n"] += 0.005 * generator.normal(size=(count, 3))
    frames["acceleration_m_s2"] = 9.81 + generator.normal(size=(count, 3))
    return StreamFilter().process(frames)


def strokes(seed, count):
    """Straight strokes to and fro at random speed and force, now and then a rest."""
    generator = np.random.default_rng(seed)
    speed, force, heading, direction = [], [], [], 0.0
    while sum(map(len, speed)) < count:
        samples = int(generator.integers(250, 1200))
        ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(80) / 80)
        profile = np.r_[ramp, np.ones(samples - 160), ramp[::-1]]
        speed.append(generator.uniform(20.0, 290.0) * profile)
        force.append(np.full(samples, generator.uniform(0.2, 2.9)))
        if generator.random() < 0.15:
            speed[-1] = np.r_[speed[-1], np.zeros(200)]
            force[-1] = np.r_[force[-1], np.zeros(200)]
        heading.append(np.full(len(speed[-1]), direction))
        direction += np.pi + generator.uniform(-0.6, 0.6)
    force_n = np.concatenate(force)[:count]
    force_n = scipy.signal.lfilter([0.04], [1.0, -0.96], force_n)
    return as_measured(
        generator,
        np.concatenate(speed)[:count] * (1.0 + 0.06 * wander(generator, count, 2.0)),
        force_n * (1.0 + 0.06 * wander(generator, count, 2.0)),
        np.concatenate(heading)[:count],
    )


def circles(seed, count, radius_mm=60.0):
    """One movement without a stop, always bending, speed and force changing all the time."""
    generator = np.random.default_rng(seed)
    speed_mm_s = 140.0 * np.exp(0.4 * wander(generator, count, 0.3))
    force_n = 1.2 * np.exp(0.4 * wander(generator, count, 0.3))
    heading = np.cumsum(speed_mm_s / RATE_HZ / radius_mm)
    return as_measured(generator, speed_mm_s, force_n, heading)


def share_near(ours, others):
    """Return the share of our boundaries that have one of the others within 10 samples."""
    mine, theirs = np.unique(ours), np.unique(others)
    return float((np.abs(mine[:, None] - theirs).min(axis=1) <= 10).mean())


@pytest.mark.parametrize("period", [250, 500, 1000, 2000])
@pytest.mark.parametrize(
    ("movement", "least_there", "least_back"), [(strokes, 0.97, 0.97), (circles, 0.9, 0.8)]
)
def test_movements_are_cut_online_as_offline(movement, least_there, least_back, period):
    """Without a stop, provisional segments that later cuts make too short to be replaced stay."""
    there, back = [], []
    for seed in range(5):
        block = movement(seed, 30_000)
        offline = ranges(segment(block))
        found = ranges(online(block, period).live.values())
        assert len(offline) > 25
        there.append(share_near(offline, found))
        back.append(share_near(found, offline))
    assert min(there) >= least_there
    assert min(back) >= least_back


@pytest.mark.skipif(not RECORDED.is_dir(), reason="recorded teleoperation is not here")
@pytest.mark.parametrize("run", ["question1a_free_motion", "question1e_free_motion"])
def test_a_persons_strokes_are_found_online_as_offline(run):
    with np.load(RECORDED / f"{run}.npz") as recorded:
        angle_rad = recorded["follower_position_rad"][::2].astype(float)
        arm_mm = 1000.0 * float(recorded["arm_length_m"])
    frames = empty_frames(len(angle_rad))
    frames["sequence"] = np.arange(len(angle_rad))
    frames["position_mm"][:, 0] = arm_mm * np.sin(angle_rad)
    frames["position_mm"][:, 1] = arm_mm * np.cos(angle_rad)
    frames["force_n"][:, 2] = 1.0
    noise = np.random.default_rng(1).normal(size=len(frames))  # no vibration was recorded
    frames["acceleration_m_s2"][:, 2] = noise
    block = StreamFilter().process(frames)
    offline = ranges(segment(block))
    assert len(offline) >= 8  # strokes to and fro at about 2 Hz for 5 s, some too curved
    for period in (250, 1000):
        assert share_near(offline, ranges(online(block, period).live.values())) >= 0.9
