"""A sensor's clock against the host's: drift, delays, jumps and load."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_sensors import MS, START_NS

from mmt.devices.streaming.sensor_clock import SensorClock


def test_a_clock_that_is_set_back_or_forward_begins_anew():
    clock = SensorClock()
    for k in range(1000):
        clock.add(START_NS + k * MS, k * MS)
    clock.add(START_NS + 1000 * MS, 9_000 * MS)  # forward
    assert clock.jumps == 1
    assert clock.sensor_time(START_NS + 1000 * MS) == 9_000 * MS
    for k in range(1001, 2800):
        clock.add(START_NS + k * MS, (8_000 + k - 50) * MS)
    assert clock.jumps == 2  # back, noticed by blocks that lie behind the line
    assert clock.sensor_time(START_NS + 2799 * MS) == (8_000 + 2799 - 50) * MS


def test_a_busy_machine_is_not_taken_for_a_jump_of_the_clock():
    clock = SensorClock()
    for k in range(6000):
        busy_ms = 20 if k % 1000 >= 500 else 0  # for half a second of each second
        clock.add(START_NS + (k + busy_ms) * MS, k * MS)
    assert clock.jumps == 0
    assert clock.drift == pytest.approx(0.0, abs=1e-6)
    assert clock.sensor_time(START_NS) == 0


@pytest.mark.parametrize(("seconds", "drift"), [(6.0, 200e-6), (7.0, 1000e-6)])
def test_a_drift_beyond_quartz_is_believed_once_it_exceeds_any_load(seconds, drift):
    """Until then, it is taken for a load that grows, and bounded."""
    clock = SensorClock()
    for k in range(round(1000 * seconds)):
        clock.add(START_NS + k * MS + 1000 * k, k * MS)
    assert clock.drift == pytest.approx(drift, abs=12e-6)
    assert clock.jumps == 0


@pytest.mark.parametrize("ahead_ms", [4.9, 5.1])
def test_a_jump_is_told_from_five_milliseconds_on(ahead_ms):
    """Ahead at once, behind after four blocks."""
    for sign, blocks in ((1, 0), (-1, 4)):
        clock = SensorClock()
        for k in range(2000):
            clock.add(START_NS + k * MS, k * MS)
        jumps = []
        for k in range(2000, 2001 + 250 * blocks):
            clock.add(START_NS + k * MS, k * MS + round(sign * ahead_ms * MS))
            jumps.append(clock.jumps)
        assert jumps == [0] * (250 * blocks) + [ahead_ms > 5.0]


def test_nothing_is_known_of_a_sensor_that_has_sent_nothing():
    with pytest.raises(ValueError, match="nothing has arrived"):
        SensorClock().sensor_time(0)


@given(
    st.lists(st.integers(0, 20 * MS), min_size=1, max_size=400),
    st.floats(-200e-6, 200e-6),
    st.integers(0, 2**62),
)
def test_no_reading_is_placed_after_its_arrival(delays_ns, drift, zero_ns):
    clock = SensorClock()
    for k, delay_ns in enumerate(delays_ns):
        stamp_ns = zero_ns + 10 * k * MS
        arrival_ns = START_NS + round(10 * k * MS * (1 + drift)) + delay_ns
        clock.add(arrival_ns, stamp_ns)
        assert clock.sensor_time(arrival_ns) >= stamp_ns - 60_000  # the drift's own doubt


@settings(max_examples=20)
@given(st.floats(-190e-6, 190e-6), st.integers(0, 1000), st.integers(-(2**60), 2**60))
def test_a_drift_is_found_below_random_delays(drift, seed, zero_ns):
    clock, delays = SensorClock(), np.random.default_rng(seed).exponential(200e3, 8000)
    assert not clock.known
    for k, delay in enumerate(delays.tolist()):
        clock.add(START_NS + round(k * MS * (1 + drift) + delay), zero_ns + k * MS)
    assert clock.jumps == 0
    assert clock.known
    assert clock.drift == pytest.approx(drift, abs=10e-6)
    host_ns = START_NS + round(9000 * MS * (1 + drift))
    assert clock.sensor_time(host_ns) == pytest.approx(zero_ns + 9000 * MS, abs=60e3)
    clock.reset()
    assert not clock.known
    clock.add(0, 5)
    assert clock.sensor_time(1000 * MS) == 1000 * MS + 5 - round(1000 * MS * clock.drift)
    assert clock.drift == pytest.approx(drift, abs=10e-6)


@given(st.lists(st.integers(0, MS), min_size=6, max_size=25))
def test_the_drift_is_that_of_the_line_below_every_block_within_its_doubt(delays_ns):
    """One reading in each block; the oracle tries every pair of them."""
    clock, points = SensorClock(), []
    for k, delay_ns in enumerate(delays_ns):
        before = clock.drift
        clock.add(START_NS + 300 * k * MS + delay_ns, 300 * k * MS)
        points.append((300 * k * MS + delay_ns, delay_ns))
        if k == 1:  # the first of all shares its block with the second
            points = [min(points, key=lambda point: point[1])]
        if k < 4:
            continue
        t, y = np.array(points, float).T
        pairs = [(i, j) for j in range(len(t)) for i in range(j) if t[i] < t.mean() <= t[j]]
        slopes = [((y[j] - y[i]) / (t[j] - t[i]), i) for i, j in pairs]
        lines = [(slope, y - y[i] - slope * (t - t[i])) for slope, i in slopes]
        slope, above = next(line for line in lines if line[1].min() > -1e-3)
        doubt = (60e3 + 2.0 * np.median(above)) / (t[-1] - t[0])
        expected = np.clip(np.clip(before, slope - doubt, slope + doubt), -200e-6, 200e-6)
        assert clock.drift == pytest.approx(expected, abs=1e-9)
