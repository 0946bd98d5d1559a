"""The accelerometer's noise: from the stream's quiet windows, and off the level."""

import numpy as np
import pytest
from stream_samples import aligned

from mmt.texture.field.cells import FieldCells
from mmt.texture.field.posterior import LevelField
from mmt.texture.signals.aligned import LEAST_WINDOWS, WINDOW, NoiseFloor


def block(count, noise, speed=0.0, force=0.0, seed=0, valid=True):
    vibration = noise * np.random.default_rng(seed).normal(size=(count, 1, 1))
    return aligned(vibration, speed_mm_s=speed, normal_force_n=force, valid=valid)


@pytest.mark.parametrize(("speed", "force"), [(200.0, 0.0), (0.0, 1.5)])
def test_the_noise_is_what_is_measured_in_the_air_or_at_rest(speed, force):
    floor = NoiseFloor()
    for seed in range(5):
        floor.update(block(1000, 0.03, speed, force, seed))
        floor.update(block(1000, 3.0, 100.0, 1.0, seed))
    assert floor.power == pytest.approx(0.03**2, rel=0.2)


def test_knocks_in_some_windows_do_not_raise_it():
    floor = NoiseFloor()
    for seed in range(6):
        floor.update(block(500, 0.03 if seed % 2 else 2.0, seed=seed))
    assert floor.power < 1.1 * 0.03**2


def test_without_enough_whole_quiet_windows_nothing_is_known():
    floor = NoiseFloor()
    floor.update(block(WINDOW - 1, 1.0))
    floor.update(block(1000, 1.0, valid=False))
    floor.update(block((LEAST_WINDOWS - 1) * WINDOW, 1.0))
    assert floor.power == 0.0


def test_the_level_is_that_of_the_texture_without_the_noise():
    random = np.random.default_rng(1)
    points = random.uniform(0.1, 0.9, (800, 2))
    texture = points[:, 0] * points[:, 1] ** 0.7
    power = (texture + 0.1) * random.chisquare(13.0, 800) / 13.0
    cells = FieldCells.from_blocks(points, power, 10 * np.arange(800))
    asked = random.uniform(0.3, 0.85, (40, 2))
    true = 10 * np.log10(asked[:, 0] * asked[:, 1] ** 0.7)
    with_noise, _ = LevelField(cells).level_db(asked)
    without, _ = LevelField(cells, noise_power=0.1).level_db(asked)
    assert np.mean(with_noise - true) > 1.0
    assert np.sqrt(np.mean((without - true) ** 2)) < 0.7


def test_a_power_below_the_noise_still_has_a_level():
    points = np.array([[0.5, 0.5], [0.6, 0.6]])
    cells = FieldCells.from_blocks(points, np.array([0.1, 1.0]), 10 * np.arange(2))
    field = LevelField(cells, noise_power=0.5)
    assert np.isfinite(field.level_db(np.array([[0.5, 0.5]]))).all()
