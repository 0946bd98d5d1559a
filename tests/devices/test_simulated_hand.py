"""The hand: human strokes that cover the plane of speed and force."""

import numpy as np
import pytest

from mmt.scene import Hand, Simulated
from mmt.testing.simulation import nominal_compliance_mm_n
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.robot import SimulatedRobot

TICKS = 18_000


def _states(seed, ticks, settings):
    hand = SimulatedHand(settings, seed)
    states = [hand.read(1) for _ in range(ticks)]
    position = np.array([state.position_mm for state in states])
    velocity = np.array([state.velocity_mm_s for state in states])
    force = np.array([state.force_n for state in states])
    return position, velocity, force, states


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
    position, velocity, force, states = _states(seed, ticks, settings)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    assert np.abs(position[:, :2]).max() < 100.0
    assert speed.max() < 1.15 * 290.0
    assert 0.0 <= force.min() < force.max() < 1.15 * 2.9
    assert np.abs(np.diff(velocity[:, :2], axis=0)).max() < 15.0  # m/s2
    assert position[:, 2].max() == pytest.approx(5.0, abs=8.0)
    assert all(state.contact == (state.force_n > 0.01) for state in states)
    assert np.all(position[force > 0.2, 2] < 0.0)
    np.testing.assert_allclose(
        np.diff(position, axis=0), velocity[1:] * 1e-3, rtol=1e-9, atol=1e-12
    )
    landed = np.diff((position[:, 2] > 2.0).astype(int)) == -1
    assert 2 <= landed.sum() <= 12
    runs = np.diff(np.concatenate([[0], ((speed < 1e-9) & (force > 0.05)).astype(int), [0]]))
    lengths = np.flatnonzero(runs == -1) - np.flatnonzero(runs == 1)
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
