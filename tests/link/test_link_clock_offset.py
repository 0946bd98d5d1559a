"""The clock estimator on simulated exchanges; the truth is known."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmt.link.clock_offset import ClockEstimate, ClockJump, ClockOffset
from mmt.link.emulated.impairments import MessageImpairments
from mmt.scene import Network

S = 1_000_000_000
MS = 1_000_000
OFFSET_NS = -98_765_432_123_456
HZ = 20

LOOPBACK = {"delay_ms": 0.15, "jitter_ms": 0.05}
WIFI = {"profile": "wifi"}
WAN = {"profile": "wan"}
BAD = {"profile": "bad"}
INDEPENDENT = {"delay_ms": 20, "jitter_ms": 20}


@dataclass
class Trace:
    """What the estimator said, and what is true."""

    clock: ClockOffset = field(default_factory=ClockOffset)
    times_s: list[float] = field(default_factory=list)
    errors_ms: list[float] = field(default_factory=list)
    jumps: list[ClockJump] = field(default_factory=list)

    def largest_error_ms(self, *, after_s):
        return max(abs(e) for t, e in zip(self.times_s, self.errors_ms, strict=True) if t > after_s)


def exchange(up, down, *, seconds=40.0, drift_ppm=0.0, steps=(), seed=1, first_s=0.0):
    """Exchange stamps over two directions of an emulated network."""
    there, back = (
        MessageImpairments(Network(**up), seed, 0),
        MessageImpairments(Network(**down), seed + 99, 0),
    )
    trace = Trace()

    def offset_ns(time_ns):
        stepped = sum(step for at_s, step in steps if time_ns >= at_s * S)
        return OFFSET_NS + round(drift_ppm * 1e-6 * time_ns) + stepped

    for index in range(round(seconds * HZ)):
        asked_ns = round(first_s * S) + index * S // HZ
        for arrived_ns in there.arrivals_ns(asked_ns, 40)[:1]:
            answered_ns = arrived_ns + 30_000
            for done_ns in back.arrivals_ns(answered_ns, 40)[:1]:
                jump = trace.clock.add(
                    done_ns,
                    answered_ns + offset_ns(answered_ns) - done_ns,
                    arrived_ns + offset_ns(arrived_ns) - asked_ns,
                )
                trace.jumps += [jump] if jump else []
                if (estimate := trace.clock.estimate) is not None:
                    trace.times_s.append(done_ns / S)
                    error_ns = estimate.at(done_ns) - offset_ns(done_ns)
                    trace.errors_ms.append(error_ns / MS)
    return trace


@pytest.mark.parametrize("drift_ppm", [-100.0, 0.0, 100.0])
@pytest.mark.parametrize(
    ("up", "down", "allowed_ms"),
    [
        (LOOPBACK, LOOPBACK, 0.05),
        (WIFI, WIFI, 1.0),
        (WAN, WAN, 5.0),
        (BAD, BAD, 30.0),
        (INDEPENDENT, INDEPENDENT, 5.0),
        (WAN, {"delay_ms": 30.0}, 5.0),
        ({"delay_ms": 90.0}, BAD, 30.0),
        (INDEPENDENT, LOOPBACK, 5.0),
    ],
    ids=["loopback", "wifi", "wan", "bad", "independent", "up only", "down only", "lopsided"],
)
def test_the_error_stays_under_half_the_jitter(up, down, allowed_ms, drift_ppm):
    trace = exchange(up, down, drift_ppm=drift_ppm)
    assert trace.largest_error_ms(after_s=10.0) < allowed_ms
    assert trace.jumps == []


@pytest.mark.parametrize("drift_ppm", [-100.0, -3.0, 100.0])
def test_the_drift_is_found(drift_ppm):
    estimate = exchange(WIFI, WIFI, drift_ppm=drift_ppm, seconds=70.0).clock.estimate
    assert estimate.drift * 1e6 == pytest.approx(drift_ppm, abs=3.0)
    quiet = exchange(LOOPBACK, LOOPBACK, drift_ppm=drift_ppm, seconds=20.0).clock.estimate
    assert quiet.drift * 1e6 == pytest.approx(drift_ppm, abs=1.0)


def closest(bounds, times):
    """The largest of each row (n, 3), and its time."""
    chosen = bounds.argmax(axis=1)[:, None]
    return tuple(np.take_along_axis(each, chosen, axis=1)[:, 0] for each in (bounds, times))


@pytest.mark.parametrize("blocks", [6, 7, 8])
@pytest.mark.parametrize("drift_ppm", [0.0, -90.0, 700.0])
def test_a_few_blocks_give_the_median_slope_and_the_closest_bounds_along_it(drift_ppm, blocks):
    generator, clock = np.random.default_rng(blocks), ClockOffset()
    times = S // 2 * np.arange(blocks)[:, None] + S // 10 * np.arange(3)
    truth, delays = drift_ppm * 1e-6 * times, generator.uniform(1.0, 1.4, (2, blocks, 3)) * MS
    least, most = np.rint(truth - delays[0]), np.rint(truth + delays[1])
    for exchanged in zip(times.flat, least.flat, most.flat, strict=True):
        time_ns, *bounds = map(int, exchanged)
        assert clock.add(5 * S + time_ns, *(OFFSET_NS + bound for bound in bounds)) is None
    (low, low_at), (high, high_at) = closest(least, times), closest(-most, times)
    drift, known = 0.0, blocks - 1  # when the last block began
    if known >= 6:
        early, late = slice(0, known - known // 2), slice(known // 2, known)
        pairs = ((low, low_at), (-high, high_at))
        slopes = np.array([(y[late] - y[early]) / (x[late] - x[early]) for y, x in pairs])
        spread = np.median(abs(slopes - np.median(slopes)))
        error = 1.86 * spread / np.sqrt(slopes.size) * (1 + 8 / slopes.size)
        drift = np.clip(np.median(slopes) / (1 + (error / 50e-6) ** 2), -500e-6, 500e-6)
    now = times[-1, -1]
    lower, upper = max(low + drift * (now - low_at)), min(-high + drift * (now - high_at))
    estimate = clock.estimate
    assert estimate.drift == pytest.approx(drift, rel=1e-9)
    assert estimate.time_ns == 5 * S + now
    assert estimate.offset_ns - OFFSET_NS == pytest.approx((lower + upper) / 2, abs=1)
    assert estimate.uncertainty_ns == pytest.approx(max(0, (upper - lower) / 2), abs=1)


def test_half_of_a_lasting_difference_of_the_ways_is_in_the_offset_and_the_uncertainty():
    """Nothing can tell it from an offset; the uncertainty says so."""
    trace = exchange({"delay_ms": 30}, {"delay_ms": 10})
    assert trace.errors_ms[-1] == pytest.approx(10.0, abs=0.1)
    estimate = trace.clock.estimate
    assert estimate.uncertainty_ns == pytest.approx(20 * MS, rel=0.01)


@pytest.mark.parametrize("network", [LOOPBACK, WIFI, WAN, BAD], ids=["loop", "wifi", "wan", "bad"])
@pytest.mark.parametrize("step_s", [-10.0, 10.0, 1.0])
def test_a_step_is_noticed_within_half_a_second(network, step_s):
    jitter_ms = Network(**network).jitter_ms
    trace = exchange(network, network, drift_ppm=40.0, steps=[(25.0, round(step_s * S))])
    (jump,) = trace.jumps
    assert trace.clock.jumps == 1
    assert 25.0 < jump.time_ns / S < 26.0
    assert jump.step_ns / MS == pytest.approx(1000 * step_s, abs=max(0.2, jitter_ms))
    assert trace.largest_error_ms(after_s=36.0) < max(0.2, jitter_ms / 2)


@pytest.mark.parametrize("step_ms", [50, -30])
def test_a_step_that_no_single_exchange_shows_is_noticed_by_both_bounds(step_ms):
    trace = exchange(WAN, WAN, steps=[(20.3, step_ms * MS)], seconds=30.0)
    (jump,) = trace.jumps
    assert 20.3 < jump.time_ns / S < 24.0
    assert jump.step_ns / MS == pytest.approx(step_ms, abs=5.0)
    assert trace.largest_error_ms(after_s=25.0) < 5.0


def test_each_of_several_steps_is_counted():
    steps = [(10.0, 10 * S), (15.0, -10 * S), (15.2, S), (22.0, -S // 2)]
    trace = exchange(WIFI, WIFI, steps=steps, seconds=30.0)
    assert [round(jump.step_ns / S, 1) for jump in trace.jumps] == [10.0, -10.0, 1.0, -0.5]
    assert trace.clock.jumps == 4


@pytest.mark.parametrize("network", [WIFI, WAN, BAD, {"delay_ms": 40, "jitter_ms": 40}])
def test_jitter_alone_is_never_taken_for_a_step(network):
    for seed in range(4):
        assert exchange(network, network, drift_ppm=80.0, seed=seed).jumps == []


@pytest.mark.parametrize(
    ("ways_ms", "drift_ppm", "pause_s"),
    [(((1, 1), (30, 30), (30, 1), (1, 1), (1, 30)), 0, 0), (((1, 1), (1, 1)), 100, 290)],
    ids=["change of the network", "silence with drift"],
)
def test_what_no_clock_does_is_no_step(ways_ms, drift_ppm, pause_s):
    clock, start_ns = ClockOffset(), 0
    for up_ms, down_ms in ways_ms:
        for now_ns in range(start_ns, start_ns + 8 * S, S // HZ):
            offset_ns = OFFSET_NS + drift_ppm * now_ns // 10**6
            assert clock.add(now_ns, offset_ns - down_ms * MS, offset_ns + up_ms * MS) is None
        start_ns += (8 + pause_s) * S
    assert abs(clock.estimate.offset_ns - offset_ns) < MS


def test_a_single_contradiction_is_left_out():
    trace = exchange(WIFI, WIFI, seconds=10.0)
    before = trace.clock.estimate
    assert before is not None
    for _ in range(2):
        assert trace.clock.add(10 * S, OFFSET_NS + 5 * S, OFFSET_NS + 6 * S) is None
    assert trace.clock.add(10 * S, OFFSET_NS - S, OFFSET_NS - S - 1) is None  # of no offset
    assert trace.clock.estimate == before
    jump = trace.clock.add(10 * S + 7, OFFSET_NS + 5 * S, OFFSET_NS + 6 * S)
    assert jump.time_ns == 10 * S + 7


def test_there_is_no_estimate_before_eight_exchanges():
    clock = ClockOffset()
    for index in range(7):
        clock.add(index * S // HZ, -MS, MS)
        assert clock.estimate is None
    clock.add(7 * S // HZ, -MS, 2 * MS)
    assert clock.estimate == ClockEstimate(7 * S // HZ, 0, 0.0, MS)
    clock.reset()
    assert clock.estimate is None
    assert clock.exchanges == 8


@given(
    st.lists(
        st.tuples(
            st.integers(-(2**62), 2**62), st.integers(-(2**62), 2**62), st.integers(0, 2**40)
        ),
        max_size=200,
    ),
    st.booleans(),
)
def test_nothing_that_is_handed_in_breaks_it(exchanges, ordered):
    clock = ClockOffset()
    for time_ns, least_ns, width_ns in sorted(exchanges) if ordered else exchanges:
        clock.add(time_ns, least_ns, least_ns + width_ns)
    estimate = clock.estimate
    assert estimate is None or (
        abs(estimate.drift) <= 500e-6
        and estimate.uncertainty_ns >= 0
        and isinstance(estimate.at(0), int)
    )


@settings(max_examples=25)
@given(st.integers(-(2**60), 2**60), st.integers(0, 2**60), st.floats(0.0, 5.0), st.integers(0, 99))
def test_the_truth_lies_within_the_uncertainty(offset_ns, start_ns, jitter_ms, seed):
    clock, generator = ClockOffset(), np.random.default_rng(seed)
    delays = lambda: int((1.0 + generator.uniform(0, jitter_ms)) * MS)  # noqa: E731
    for index in range(200):
        clock.add(start_ns + index * S // HZ, offset_ns - delays(), offset_ns + delays())
    estimate = clock.estimate
    # the drift is none, and found to be little
    slack_ns = round(abs(estimate.drift) * 10 * S) + 10
    assert abs(estimate.offset_ns - offset_ns) <= estimate.uncertainty_ns + slack_ns
