"""Kinds of simulated hands, each with its own way to move."""

from itertools import pairwise

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.scene import Hand, Scene
from mmt.scene.device_tables import HAND_KINDS
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.motions import KINDS
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.course import SurfaceCourse
from mmt.testing.simulation.surfaces.textures import SURFACES

TICKS = 40_000


def _moved(kind, **keys):
    """Return position (n, 3), speed and force (n,) of a hand, after it has come down."""
    hand = SimulatedHand(Hand(kind=kind, **keys), 3)
    states = [hand.read(1) for _ in range(TICKS)][621:]
    position = np.array([state.position_mm for state in states])
    speed = np.array([np.hypot(*state.velocity_mm_s[:2]) for state in states])
    return position, speed, np.array([state.force_n for state in states])


def _runs(values):
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(int), [0]])))
    return np.diff(edges)[::2]


@pytest.mark.parametrize("headings", ["opposite", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_keeps_to_its_ranges_and_within_reach(kind, headings):
    keys = {"slowest_mm_s": 60.0, "fastest_mm_s": 160.0, "lightest_n": 0.5, "strongest_n": 1.5}
    position, speed, force = _moved(kind, headings=headings, **keys)
    assert np.hypot(*position[:, :2].T).max() < 100.0
    assert 100.0 < speed.max() < 1.15 * 160.0
    assert 1.0 < force.max() < 1.15 * 1.5
    assert 0.2 < (force > 0.1).mean() < 1.0


def test_each_kind_moves_in_its_own_way():
    _, speed, _ = _moved("quick")
    turns = np.flatnonzero(
        (speed[1:-1] <= speed[:-2]) & (speed[1:-1] < speed[2:]) & (speed[1:-1] < 8)
    )
    peaks = [speed[a:b].max() for a, b in pairwise(turns) if 240 <= b - a <= 710]
    assert len(peaks) > 20  # strokes from rest to rest
    assert min(peaks) < 80.0 < 220.0 < max(peaks)
    position, speed, _ = _moved("circles")
    velocity, moving = np.gradient(position[:, :2], 1e-3, axis=0), speed > 20.0
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    radius = (speed / np.maximum(np.abs(np.gradient(heading, 1e-3)), 1e-6))[moving]
    assert 7.0 < np.percentile(radius, 2) < np.percentile(radius, 98) < 32.0
    counts = np.bincount((heading[moving] * 6 / np.pi).astype(int) % 12, minlength=12)
    assert counts.min() > 0.5 * counts.mean()
    _, speed, force = _moved("taps")
    touches = _runs(force > 0.05)
    assert len(touches) > 2 * TICKS / 1000 * 0.7
    assert np.median(touches) < 400
    position, speed, _ = _moved("scratching")
    velocity = np.gradient(position[:, :2], 1e-3, axis=0)
    opposite = (velocity[40:] * velocity[:-40]).sum(axis=1) < -0.5 * speed[40:] * speed[:-40]
    assert 4.0 < len(_runs(opposite)) / (len(speed) / 1000.0) < 15.0
    _, speed, force = _moved("pauses")
    still = speed < 1e-9
    assert still.mean() > 0.5
    assert (_runs(still & (force > 0.1)) > 300).sum() >= 3
    assert (_runs(still & (force < 0.01)) > 200).sum() >= 3


@pytest.mark.parametrize("kind", HAND_KINDS)
def test_a_course_is_gone_through_by_every_kind_of_hand(kind):
    surfaces = [SURFACES["plastic"], SURFACES["felt"], SURFACES["sandpaper"]]
    course = SurfaceCourse.draw(surfaces, stay_s=4.0, when="either", duration_s=32.0, seed=2)
    assert {change.in_contact for change in course.changes} == {True, False}
    frames, _ = simulate_session(Scene(hand=Hand(kind=kind)), course, 32.0, 2)
    gone = np.flatnonzero(
        np.diff(course.places_by_frame(frames["force_n"][:, 2].astype(np.float64)))
    )
    assert len(gone) >= 0.6 * len(course.changes)


def test_a_kind_that_is_not_known_is_named_with_those_that_are():
    tables = {"link": {}, "simulated": {}, "hand": {"kind": "quik"}, "recording": {}}
    with pytest.raises(InputError, match=r"hand.kind: 'quik' is not known, allowed are strokes, q"):
        scene_from_tables(tables)
    with pytest.raises(InputError, match=r"path none\.npz: No such file"):
        SimulatedHand(Hand(kind="none.npz"), 1)
