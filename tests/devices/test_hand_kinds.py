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


def _moved(kind, seed=3, ticks=TICKS, **keys):
    """Return position (n, 3), speed and force (n,) of a hand, after it has come down."""
    hand = SimulatedHand(Hand(kind=kind, **keys), seed)
    states = [hand.read(1) for _ in range(ticks)][621:]
    position = np.array([state.position_mm for state in states])
    speed = np.array([np.hypot(*state.velocity_mm_s[:2]) for state in states])
    return position, speed, np.array([state.force_n for state in states])


def _runs(values):
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(int), [0]])))
    return np.diff(edges)[::2]


def test_the_scene_names_every_kind():
    assert ("strokes", *KINDS) == HAND_KINDS


@pytest.mark.parametrize("headings", ["opposite", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_keeps_to_its_ranges_and_within_reach(kind, headings):
    keys = {"slowest_mm_s": 60.0, "fastest_mm_s": 160.0, "lightest_n": 0.5, "strongest_n": 1.5}
    position, speed, force = _moved(kind, headings=headings, **keys)
    assert np.hypot(*position[:, :2].T).max() < 100.0
    assert 100.0 < speed.max() < 1.15 * 160.0
    assert 1.0 < force.max() < 1.15 * 1.5
    assert 0.2 < (force > 0.1).mean() < 1.0


def test_quick_strokes_are_trapezoids_from_rest_to_rest():
    _, speed, _ = _moved("quick")
    lengths, peaks = [], []
    edges = np.flatnonzero(np.diff((speed > 0).astype(int)))
    slow = np.flatnonzero(
        (speed[1:-1] < speed[:-2]) & (speed[1:-1] < speed[2:]) & (speed[1:-1] < 8)
    )
    turns = np.unique(np.concatenate([edges, slow]))
    for start, stop in pairwise(turns):
        if stop - start > 200 and speed[start + 20 : stop - 20].min() > 0.0:
            stroke = speed[start:stop]
            lengths.append(stop - start)
            peaks.append(stroke.max())
            ramp = round(0.15 * len(stroke))
            assert stroke[ramp // 2] == pytest.approx(0.5 * np.median(stroke), rel=0.2)
    assert len(lengths) > 20
    assert 240 <= min(lengths) < 400 < max(lengths) <= 710
    assert min(peaks) < 80.0 < 220.0 < max(peaks)


def test_circles_have_the_radii_stated_and_all_headings():
    position, speed, _ = _moved("circles")
    moving = speed > 20.0
    velocity = np.gradient(position[:, :2], 1e-3, axis=0)
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    radius = (speed / np.maximum(np.abs(np.gradient(heading, 1e-3)), 1e-6))[moving]
    assert np.percentile(radius, 2) > 7.0
    assert np.percentile(radius, 98) < 32.0
    counts = np.bincount((heading[moving] * 6 / np.pi).astype(int) % 12, minlength=12)
    assert counts.min() > 0.5 * counts.mean()


def test_taps_make_and_break_contact():
    _, speed, force = _moved("taps")
    touches = _runs(force > 0.05)
    assert len(touches) > 2 * TICKS / 1000 * 0.7
    assert np.median(touches) < 400
    assert 0.2 < (speed[force > 0.2] > 5.0).mean() < 0.8


def test_scratching_reverses_many_times_a_second():
    position, speed, _ = _moved("scratching")
    velocity = np.gradient(position[:, :2], 1e-3, axis=0)
    opposite = (velocity[40:] * velocity[:-40]).sum(axis=1) < -0.5 * speed[40:] * speed[:-40]
    assert 4.0 < len(_runs(opposite)) / (len(speed) / 1000.0) < 15.0


def test_pauses_stand_still_for_long_on_the_surface_and_above():
    _, speed, force = _moved("pauses")
    still = speed < 1e-9
    assert still.mean() > 0.5
    assert (_runs(still & (force > 0.1)) > 300).sum() >= 3
    assert (_runs(still & (force < 0.01)) > 200).sum() >= 3


def test_a_recorded_stroke_is_followed_for_as_long_as_the_session_lasts(tmp_path):
    time_s = np.arange(0.0, 4.0, 0.002)
    wave = 2.0 * np.pi * time_s
    position_mm = np.column_stack([30.0 * np.sin(wave), 5.0 * time_s, 0.0 * time_s])
    force_n = np.column_stack([0.0 * wave, 0.0 * wave, 1.0 + 0.5 * np.sin(0.7 * wave)])
    file = tmp_path / "stroke.npz"
    np.savez(file, time_s=time_s, position_mm=position_mm, force_n=force_n)
    position, _, force = _moved(str(file), ticks=20_000)
    part = slice(500, 1500)
    expected = 30.0 * np.sin(2.0 * np.pi * np.arange(20_000 - 621) * 1e-3)[part]
    assert np.corrcoef(position[part, 0], expected)[0, 1] > 0.99
    assert np.abs(position[:, 0]).max() < 36.0
    assert np.abs(position[:, 1]).max() < 25.0
    assert np.abs(np.diff(position[:, 0])).max() < 1.4 * 30.0 * 2.0 * np.pi * 1e-3
    assert force.min() == pytest.approx(0.5, abs=0.1)
    assert force.max() == pytest.approx(1.5, abs=0.2)


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
