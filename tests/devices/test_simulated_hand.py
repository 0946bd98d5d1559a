"""The hand: strokes as of a person that cover the plane, and kinds that move in other ways."""

from itertools import pairwise

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.scene import Hand, Scene, Simulated
from mmt.scene.device_tables import HAND_KINDS
from mmt.scene.files import scene_from_tables
from mmt.testing.simulation import nominal_compliance_mm_n
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.motions import KINDS
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.robot import SimulatedRobot
from mmt.testing.simulation.surfaces.course import SurfaceCourse
from mmt.testing.simulation.surfaces.textures import SURFACES

TICKS = 18_000
KIND_TICKS = 40_000


def moved(settings, seed=3, ticks=KIND_TICKS, landed=621):
    """Return position and velocity (n, 3), speed and force (n,) once a hand has come down."""
    hand = SimulatedHand(settings, seed)
    states = [hand.read(1) for _ in range(ticks)][landed:]
    assert all(state.contact == (state.force_n > 0.01) for state in states)
    position = np.array([state.position_mm for state in states])
    velocity = np.array([state.velocity_mm_s for state in states])
    force = np.array([state.force_n for state in states])
    return position, velocity, np.hypot(*velocity[:, :2].T), force


def runs(values):
    """Return for how many ticks each of these lasted."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], values.astype(int), [0]])))
    return np.diff(edges)[::2]


def _stroke_with_robot(table, hand, ticks=TICKS, feedback=False):
    robot = SimulatedRobot(table, 0.3)
    rows = np.empty((ticks, 3))
    for tick in range(ticks):
        state = hand.read(1)
        tip = robot.advance(state.position_mm)
        if feedback:
            hand.write(tip.force_n)
        u, v, _ = tip.velocity_mm_s
        rows[tick] = np.hypot(u, v), tip.force_n[2], state.force_n
    return rows.T


def _steady_stretches(speed, force):
    """Return (number, mean speed, mean force) of the stretches that are steady."""
    stretches = np.reshape([speed, force], (2, -1, 120))
    means, deviations = stretches.mean(axis=2), stretches.std(axis=2)
    steady = (deviations <= 0.12 * means).all(axis=0) & (means > [[10.0], [0.1]]).all(axis=0)
    return [(int(k), *means[:, k]) for k in np.flatnonzero(steady)]


@pytest.mark.parametrize("seed", [1, 2, 7, 12345])
def test_covers_the_plane_within_18_s_with_the_force_that_it_intends(seed):
    speed, force, intended = _stroke_with_robot(Simulated(), SimulatedHand(Hand(), seed))
    found = _steady_stretches(speed, force)
    assert len(found) > 30
    thirds = {(int(v / 100.0), int(f)) for _, v, f in found}
    assert len(thirds) >= 8  # of nine
    for k, _, mean in found:
        assert mean == pytest.approx(intended[120 * k : 120 * k + 120].mean(), rel=0.15)


@pytest.mark.parametrize(
    ("seed", "keys"),
    [(1, {}), (2, {"headings": "all"}), (3, {"rest_share": 0.0}), (99, {"rest_share": 0.5})],
)
def test_moves_as_a_person_does(seed, keys):
    settings, ticks = Hand(**keys), 60_000
    position, velocity, speed, force = moved(settings, seed, ticks, landed=0)
    assert np.abs(position[:, :2]).max() < 100.0
    assert speed.max() < 1.15 * 290.0
    assert 0.0 <= force.min() < force.max() < 1.15 * 2.9
    assert np.abs(np.diff(velocity[:, :2], axis=0)).max() < 15.0  # m/s2
    assert position[:, 2].max() == pytest.approx(5.0, abs=8.0)
    assert np.all(position[force > 0.2, 2] < 0.0)
    np.testing.assert_allclose(
        np.diff(position, axis=0), velocity[1:] * 1e-3, rtol=1e-9, atol=1e-12
    )
    landed = np.diff((position[:, 2] > 2.0).astype(int)) == -1
    assert 2 <= landed.sum() <= 12
    lengths = runs((speed < 1e-9) & (force > 0.05))
    resting = lengths[lengths > 150].sum() / ticks
    assert resting == pytest.approx(settings.rest_share, abs=0.08)
    heading = np.arctan2(velocity[speed > 10.0, 1], velocity[speed > 10.0, 0]) % (2.0 * np.pi)
    counts = np.bincount((heading * 6.0 / np.pi).astype(int) % 12, minlength=12)
    if settings.headings == "all":
        assert counts.min() > 0.025 * counts.sum()
        assert counts.std() < 0.45 * counts.mean()


def test_the_course_does_not_depend_on_how_ticks_are_grouped():
    one, many = SimulatedHand(Hand(), 8), SimulatedHand(Hand(), 8)
    for elapsed in (3, 2, 5, 1, 40) * 60:
        grouped = many.read(elapsed)
        for _ in range(elapsed):
            single = one.read(1)
        assert grouped == single


def test_feedback_corrects_a_wrong_expectation():
    """The hand expects 5 N/mm and meets 1 N/mm: it feels too little and presses deeper."""
    table = Simulated(surface_stiffness_n_mm=1.0)
    expected = nominal_compliance_mm_n(Simulated())
    assert nominal_compliance_mm_n(table) > 2.0 * expected
    errors = {}
    for feedback in (False, True):
        hand = SimulatedHand(Hand(), 2)
        _, force, intended = _stroke_with_robot(table, hand, 9000, feedback)
        pressing = intended[4000:] > 0.3
        ratio = force[4000:][pressing] / intended[4000:][pressing]
        errors[feedback] = abs(np.median(ratio) - 1.0)
    assert errors[False] > 0.4
    assert errors[True] < 0.1


def test_a_hand_that_feels_nothing_at_all_corrects_nothing():
    """As while its handle or control is away; a force that is merely too small is corrected."""
    depths = []
    for felt_n in (None, 0.0, 0.05):
        hand = SimulatedHand(Hand(), 3)
        places = []
        for _ in range(4000):
            places.append(hand.read(1).position_mm[2])
            if felt_n is not None:
                hand.write((0.0, 0.0, felt_n))
        depths.append(min(places))
    unfelt, nothing, little = depths
    assert nothing == unfelt
    assert little < 1.5 * unfelt  # both are below the surface


@pytest.mark.parametrize("headings", ["opposite", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_keeps_to_its_ranges_and_within_reach(kind, headings):
    keys = {"slowest_mm_s": 60.0, "fastest_mm_s": 160.0, "lightest_n": 0.5, "strongest_n": 1.5}
    position, _, speed, force = moved(Hand(kind=kind, headings=headings, **keys))
    assert np.hypot(*position[:, :2].T).max() < 100.0
    assert 100.0 < speed.max() < 1.15 * 160.0
    assert 1.0 < force.max() < 1.15 * 1.5
    assert 0.2 < (force > 0.1).mean() < 1.0


def test_each_kind_moves_in_its_own_way():
    *_, speed, _ = moved(Hand(kind="quick"))
    turns = np.flatnonzero(
        (speed[1:-1] <= speed[:-2]) & (speed[1:-1] < speed[2:]) & (speed[1:-1] < 8)
    )
    peaks = [speed[a:b].max() for a, b in pairwise(turns) if 240 <= b - a <= 710]
    assert len(peaks) > 20  # strokes from rest to rest
    assert min(peaks) < 80.0 < 220.0 < max(peaks)
    position, _, speed, _ = moved(Hand(kind="circles"))
    velocity, moving = np.gradient(position[:, :2], 1e-3, axis=0), speed > 20.0
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    radius = (speed / np.maximum(np.abs(np.gradient(heading, 1e-3)), 1e-6))[moving]
    assert 7.0 < np.percentile(radius, 2) < np.percentile(radius, 98) < 32.0
    counts = np.bincount((heading[moving] * 6 / np.pi).astype(int) % 12, minlength=12)
    assert counts.min() > 0.5 * counts.mean()
    *_, speed, force = moved(Hand(kind="taps"))
    touches = runs(force > 0.05)
    assert len(touches) > 2 * KIND_TICKS / 1000 * 0.7
    assert np.median(touches) < 400
    position, _, speed, _ = moved(Hand(kind="scratching"))
    velocity = np.gradient(position[:, :2], 1e-3, axis=0)
    opposite = (velocity[40:] * velocity[:-40]).sum(axis=1) < -0.5 * speed[40:] * speed[:-40]
    assert 4.0 < len(runs(opposite)) / (len(speed) / 1000.0) < 15.0
    *_, speed, force = moved(Hand(kind="pauses"))
    still = speed < 1e-9
    assert still.mean() > 0.5
    assert (runs(still & (force > 0.1)) > 300).sum() >= 3
    assert (runs(still & (force < 0.01)) > 200).sum() >= 3


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
