"""The hand: human strokes that cover the plane of speed and force."""

import numpy as np
import pytest

from mmt.scene import Hand, Simulated
from mmt.testing.simulation import nominal_compliance_mm_n
from mmt.testing.simulation.hand import SimulatedHand
from mmt.testing.simulation.robot import SimulatedRobot

TICKS = 18_000
CENTRES = [((2 * i + 1) / 6, (2 * j + 1) / 6) for i in range(3) for j in range(3)]


def _states(seed, ticks=TICKS, settings=None):
    hand = SimulatedHand(settings or Hand(), seed)
    states = [hand.read(1) for _ in range(ticks)]
    position = np.array([state.position_mm for state in states])
    velocity = np.array([state.velocity_mm_s for state in states])
    force = np.array([state.force_n for state in states])
    return position, velocity, force, states


def _stroke_with_robot(seed, table, hand, ticks=TICKS, feedback=False):
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


def _steady_stretches(speed, force, shortest=120, longest=1000, share=0.12):
    """Return (start, stop, mean speed, mean force) of stretches that are steady, taken greedily."""
    sums = [np.concatenate([[0.0], np.cumsum(x)]) for x in (speed, speed**2, force, force**2)]

    def steady(start, stop):
        means = [(total[stop] - total[start]) / (stop - start) for total in sums]
        deviations = np.sqrt(np.maximum([means[1] - means[0] ** 2, means[3] - means[2] ** 2], 0))
        if means[0] < 10.0 or means[2] < 0.1:
            return None
        good = deviations[0] <= share * means[0] and deviations[1] <= share * means[2]
        return (start, stop, means[0], means[2]) if good else None

    found, start = [], 0
    while start + shortest <= len(speed):
        best = steady(start, start + shortest)
        if best is None:
            start += 5
            continue
        while best[1] + 5 <= min(len(speed), start + longest):
            longer = steady(start, best[1] + 5)
            if longer is None:
                break
            best = longer
        found.append(best)
        start = best[1]
    return found


def _distance(points):
    """Paper A's completion figure: nine centres, three nearest samples each."""
    return sum(np.sort(np.hypot(points[:, 0] - x, points[:, 1] - y))[:3].sum() for x, y in CENTRES)


@pytest.mark.parametrize("seed", [1, 2, 7, 12345])
def test_covers_the_plane_within_18_s(seed):
    table = Simulated()
    speed, force, _ = _stroke_with_robot(seed, table, SimulatedHand(Hand(), seed))
    found = _steady_stretches(speed, force)
    points = np.array([(v / 300.0, f / 3.0) for _, _, v, f in found])
    times = np.array([stop for _, stop, _, _ in found]) * 1e-3
    sums = np.array([_distance(points[:count]) for count in range(3, len(points) + 1)])
    started = times[2:][sums <= 7.5][0]
    stopped = times[2:][sums <= 4.243][0]
    assert 2.0 < started < 4.5
    assert 6.0 < stopped < 13.0
    assert 30 <= len(found) <= 60


@pytest.mark.parametrize("seed", [1, 2, 3, 99])
def test_moves_as_a_person_does(seed):
    position, velocity, force, states = _states(seed)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    assert np.abs(position[:, :2]).max() < 100.0
    assert speed.max() < 1.15 * 290.0
    assert force.max() < 1.15 * 2.9
    assert force.min() >= 0.0
    acceleration = np.diff(velocity[:, :2], axis=0) * 1000.0
    assert np.abs(acceleration).max() < 15_000.0
    turns = (speed[1:-1] < 2.0) & (speed[:-2] >= 2.0)
    assert 8 < turns.sum() < 40
    assert position[:, 2].max() == pytest.approx(5.0, abs=8.0)
    assert all(state.contact == (state.force_n > 0.01) for state in states)
    pressing = force > 0.2
    assert np.all(position[pressing, 2] < 0.0)
    np.testing.assert_allclose(
        np.diff(position, axis=0), velocity[1:] * 1e-3, rtol=1e-9, atol=1e-12
    )


def test_lifts_off_and_rests_now_and_then():
    position, velocity, force, _ = _states(4, ticks=60_000)
    landed = np.diff((position[:, 2] > 2.0).astype(int)) == -1
    assert 2 <= landed.sum() <= 12
    still = (np.hypot(velocity[:, 0], velocity[:, 1]) < 1e-9) & (force > 0.05)
    lengths = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]]))))[::2]
    assert (lengths > 180).sum() >= 2


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_rest_share_is_kept(share):
    _, velocity, force, _ = _states(4, ticks=60_000, settings=Hand(rest_share=share))
    still = (np.hypot(velocity[:, 0], velocity[:, 1]) < 1e-9) & (force > 0.05)
    runs = np.diff(np.concatenate([[0], still.astype(int), [0]]))
    lengths = np.flatnonzero(runs == -1) - np.flatnonzero(runs == 1)
    resting = lengths[lengths > 150].sum() / 60_000
    assert resting == pytest.approx(share, abs=0.08)


def test_speed_and_force_vary_by_a_few_percent_when_steady():
    speed, force, _ = _stroke_with_robot(3, Simulated(), SimulatedHand(Hand(), 3))
    found = _steady_stretches(speed, force, longest=200, share=0.06)
    assert len(found) > 20
    spread = [force[stop - 100 : stop].std() / mean for _, stop, _, mean in found]
    assert 0.004 < np.median(spread) < 0.05


@pytest.mark.parametrize("partition", [(3,), (2, 5, 1), (40,)])
def test_the_course_does_not_depend_on_how_ticks_are_grouped(partition):
    one, many = SimulatedHand(Hand(), 8), SimulatedHand(Hand(), 8)
    for _ in range(60):
        for elapsed in partition:
            grouped = many.read(elapsed)
            for _ in range(elapsed):
                single = one.read(1)
            assert grouped == single


def test_seeds_differ():
    ends = {SimulatedHand(Hand(), seed).read(3000).position_mm for seed in range(5)}
    assert len(ends) == 5


@pytest.mark.parametrize("seed", [1, 5])
def test_force_follows_what_the_hand_intends(seed):
    speed, force, intended = _stroke_with_robot(seed, Simulated(), SimulatedHand(Hand(), seed))
    found = _steady_stretches(speed, force)
    assert len(found) > 30
    for start, stop, _, mean in found:
        assert mean == pytest.approx(intended[start:stop].mean(), rel=0.1)


def test_feedback_corrects_a_wrong_expectation():
    """The hand expects 5 N/mm and meets 1 N/mm: it feels too little and presses deeper."""
    table = Simulated(surface_stiffness_n_mm=1.0)
    expected = nominal_compliance_mm_n(Simulated())
    assert nominal_compliance_mm_n(table) > 2.0 * expected
    errors = {}
    for feedback in (False, True):
        hand = SimulatedHand(Hand(), 2)
        _, force, intended = _stroke_with_robot(2, table, hand, 9000, feedback)
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


def test_narrow_ranges_are_respected():
    settings = Hand(slowest_mm_s=50.0, fastest_mm_s=60.0, lightest_n=1.0, strongest_n=1.1)
    _, velocity, force, _ = _states(6, ticks=10_000, settings=settings)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    assert speed.max() < 60.0 * 1.15
    assert force.max() < 1.1 * 1.15
    assert 45.0 < np.median(speed[speed > 40.0]) < 65.0


@pytest.mark.parametrize("seed", [1, 4, 9, 77])
def test_a_hand_for_all_headings_covers_them_evenly_and_stays_in_reach(seed):
    counts = {}
    for headings in ("opposite", "all"):
        position, velocity, _, _ = _states(seed, ticks=20_000, settings=Hand(headings=headings))
        assert np.abs(position[:, :2]).max() < 100.0
        moving = np.hypot(velocity[:, 0], velocity[:, 1]) > 10.0
        heading = np.arctan2(velocity[moving, 1], velocity[moving, 0]) % (2.0 * np.pi)
        counts[headings] = np.bincount((heading * 6.0 / np.pi).astype(int) % 12, minlength=12)
    assert counts["all"].min() > 0.025 * counts["all"].sum()
    assert counts["all"].std() < 0.7 * counts["opposite"].std()
