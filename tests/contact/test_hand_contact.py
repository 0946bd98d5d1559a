"""The hand's own contact and force, against the surface as it is, over every network."""

import numpy as np
import pytest

from mmt.contact.rendering import HandContact
from mmt.scene import Simulated
from mmt.testing.simulation import START_MM
from mmt.testing.simulation.robot import SimulatedRobot, tip_drive
from mmt_lab.feedback.simulated import DelayLine

SETTLED = 4000
"""Ticks after which every surface has been touched some times."""


def touches_mm(rng, ticks):
    """Return heights of a hand that touches, presses to and fro and lets go, (ticks,)."""
    times, heights = [0.0, 0.3], [5.0, 5.0]

    def go_on(seconds, height):
        times.append(times[-1] + seconds)
        heights.append(height)

    while times[-1] < ticks / 1000.0:
        go_on(rng.uniform(0.04, 0.2), -rng.uniform(1.0, 6.0))
        for _ in range(rng.integers(1, 4)):
            go_on(rng.uniform(0.1, 0.5), -rng.uniform(1.0, 6.0))
        go_on(rng.uniform(0.04, 0.2), rng.uniform(1.5, 5.0))
        go_on(rng.uniform(0.15, 0.5), heights[-1])
    now = np.arange(ticks) / 1000.0
    place = np.clip(np.searchsorted(times, now, side="right") - 1, 0, len(times) - 2)
    start, end = np.array(times)[place], np.array(times)[place + 1]
    share = 0.5 - 0.5 * np.cos(np.pi * np.clip((now - start) / (end - start), 0.0, 1.0))
    before, after = np.array(heights)[place], np.array(heights)[place + 1]
    return before + share * (after - before)


def edges(contact):
    change = np.diff(contact.astype(int))
    return [np.flatnonzero(change == sign) for sign in (1, -1)]


@pytest.mark.parametrize("delay_ms", [1, 50, 150])
@pytest.mark.parametrize(("wall_n_mm", "bandwidth_hz"), [(0.5, 15.0), (2.0, 8.0), (10.0, 40.0)])
def test_contact_comes_and_goes_with_the_hand_and_its_force_is_that_of_the_robot_at_rest(
    delay_ms, wall_n_mm, bandwidth_hz
):
    """The oracle is the statics of two springs in series, at the hand's own place."""
    rng = np.random.default_rng(delay_ms + round(10 * wall_n_mm))
    heights_mm = touches_mm(rng, 16_000)
    settings = Simulated(surface_stiffness_n_mm=wall_n_mm, robot_bandwidth_hz=bandwidth_hz)
    robot, contact = SimulatedRobot(settings, 0.0), HandContact()
    down = DelayLine(delay_ms, delay_ms // 4, 1)
    up = DelayLine(delay_ms, delay_ms // 4, 2)
    command = START_MM
    known = np.zeros(len(heights_mm))
    for tick, height_mm in enumerate(heights_mm.tolist()):
        down.push(tick, height_mm)
        for wanted_mm in down.pop(tick):
            command = (0.0, 0.0, wanted_mm)
        tip = robot.advance(command)
        force_n = tip.force_n[2] + rng.normal(0.0, 0.01)
        up.push(tick, (-1e-3 * command[2], -1e-3 * tip.position_mm[2], force_n))
        for sample in up.pop(tick):
            contact.update(*sample)
        known[tick] = contact.force_n(-1e-3 * height_mm) or 0.0
    arm_n_mm = 1e-3 * tip_drive(bandwidth_hz)[0].stiffness_n_m
    series_n_mm = 1.0 / (1.0 / arm_n_mm + 1.0 / wall_n_mm)
    wanted = series_n_mm * np.maximum(-heights_mm, 0.0)[SETTLED:]
    found = known[SETTLED:]
    error = np.sqrt(np.mean((found - wanted) ** 2) / np.mean(wanted**2))
    assert error < 0.02
    for mine, own in zip(edges(found > 0.0), edges(heights_mm[SETTLED:] < 0.0), strict=True):
        assert len(mine) == len(own) > 5
        assert np.abs(mine - own).max() <= 4
        assert np.median(np.abs(mine - own)) <= 1


def test_numbers_that_are_none_teach_nothing_and_an_untouched_surface_is_not_known():
    contact = HandContact()
    for _ in range(100):
        contact.update(np.nan, 0.0, 1.0)
        contact.update(-1e-3, -1e-3, 0.0)
    assert contact.force_n(1e-3) is None
    assert contact.stiffness_n_m is None
