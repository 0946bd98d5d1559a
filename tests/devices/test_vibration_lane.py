"""Vibration between readings: against sines that are known, on any spacing, around gaps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmt.devices.protocols import SensorReading
from mmt.devices.streaming.lanes import WAITING, Lane
from mmt.devices.streaming.vibration_lane import BEFORE, PHASES, VibrationLane, weights, weights_for


def readings_of(rate_hz, frequency_hz, count, phase=0.3):
    """A sine along x and its quadrature along y, on top of a line along z."""
    readings = []
    for k in range(count):
        time_ns = round(k * 1e9 / rate_hz)
        angle = 2 * math.pi * frequency_hz * time_ns * 1e-9 + phase
        readings.append(
            SensorReading(time_ns, (math.cos(angle), math.sin(angle), 9.81 + 2e-9 * time_ns))
        )
    return readings


def lane_of(readings, kind=VibrationLane):
    lane = kind()
    for reading in readings:
        lane.add([reading], reading.time_ns)
    return lane


def responses(rate_hz, frequency_hz):
    """The complex gain at instants that lie anywhere between two readings."""
    readings = readings_of(rate_hz, frequency_hz, 500)
    lane = lane_of(readings)
    found = []
    for k in range(97):
        time_ns = readings[10].time_ns + k * round(2.61803e9 / rate_hz)
        x, y, _ = lane.at(time_ns)
        angle = 2 * math.pi * frequency_hz * time_ns * 1e-9 + 0.3
        found.append(complex(x, y) / complex(math.cos(angle), math.sin(angle)))
    return np.array(found)


@pytest.mark.parametrize(
    ("rate_hz", "frequency_hz", "least", "most", "error"),
    [
        (4000, 450, 0.99, 1.01, 0.015),
        (4000, 500, 0.99, 1.02, 0.03),
        (2000, 100, 0.99, 1.01, 0.01),
        (2000, 300, 0.98, 1.01, 0.025),
        (2000, 450, 0.98, 1.01, 0.025),
        (2000, 500, 1.0, 1.05, 0.06),
        (1000, 100, 0.95, 1.01, 0.1),
        (1000, 300, 0.94, 1.01, 0.06),
        (1000, 400, 0.97, 1.1, 0.15),
    ],
)
def test_a_sine_comes_out_with_the_stated_gain_and_error(rate_hz, frequency_hz, least, most, error):
    """The figures of docs/explanation/sensor-clocks.md, with little room."""
    gains = responses(rate_hz, frequency_hz)
    assert least <= abs(gains).min()
    assert abs(gains).max() <= most
    assert abs(gains - 1).max() <= error


@given(
    rate_hz=st.floats(500.0, 8000.0),
    start=st.floats(-50.0, 50.0),
    slope=st.floats(-1e4, 1e4),
    instant=st.floats(0.0, 1.0),
)
def test_what_stands_or_moves_evenly_comes_out_as_it_is(rate_hz, start, slope, instant):
    times_ns = [round(k * 1e9 / rate_hz) for k in range(30)]
    lane = lane_of([SensorReading(t, (start, start + slope * t * 1e-9, -start)) for t in times_ns])
    time_ns = times_ns[12] + round(instant * 1e9 / rate_hz)
    x, y, z = lane.at(time_ns)
    step = abs(slope) / rate_hz
    assert x == pytest.approx(start, abs=1e-9 * (1 + abs(start)))
    assert z == pytest.approx(-start, abs=1e-9 * (1 + abs(start)))
    assert y == pytest.approx(start + slope * time_ns * 1e-9, abs=1e-6 + 0.51 * step / PHASES)


@given(
    st.lists(st.integers(100_000, 4_000_000), min_size=1, max_size=40),
    st.lists(st.integers(0, 2_000_000), min_size=1, max_size=30),
)
def test_a_value_is_there_exactly_when_that_of_a_straight_line_is(steps_ns, moves_ns):
    """So that what is fast costs no time, and no frame more is left out."""
    times_ns = np.cumsum(steps_ns).tolist()
    readings = [SensorReading(t, (1.0, 2.0, 3.0)) for t in times_ns]
    straight, shaped = lane_of(readings, Lane), lane_of(readings)
    for time_ns in np.cumsum(moves_ns).tolist():
        expected, found = straight.at(time_ns), shaped.at(time_ns)
        if expected is None or expected is WAITING:
            assert found is expected
        else:
            assert found == pytest.approx((1.0, 2.0, 3.0))


def test_where_readings_lack_around_it_a_value_lies_on_a_straight_line():
    readings = readings_of(2000, 300, 60)
    del readings[30]
    shaped, straight = lane_of(readings), lane_of(readings, Lane)
    on_line = []
    for k in range(50):
        time_ns = 500_000 * k + 250_000
        found, line = shaped.at(time_ns), straight.at(time_ns)
        angle = 2 * math.pi * 300 * time_ns * 1e-9 + 0.3
        if found == line:
            on_line.append(k)
        else:
            assert math.dist(found[:2], (math.cos(angle), math.sin(angle))) < 0.03
    assert on_line == [*range(BEFORE - 1), *range(29, 30 + BEFORE)]
    assert shaped.at(-1) is None


def test_a_sensor_that_comes_back_at_another_rate_has_other_weights():
    lane = lane_of(readings_of(1000, 300, 400))
    assert isinstance(lane.at(300_000_000), tuple)
    lane.reset()
    readings = readings_of(4000, 300, 2000)
    for reading in readings:
        lane.add([reading], reading.time_ns)
    time_ns = readings[1900].time_ns + 120_000
    x, y, _ = lane.at(time_ns)
    angle = 2 * math.pi * 300 * time_ns * 1e-9 + 0.3
    assert math.dist((x, y), (math.cos(angle), math.sin(angle))) < 0.02


@given(
    rate_hz=st.floats(500.0, 8000.0),
    later_hz=st.floats(500.0, 8000.0),
    lost=st.sets(st.integers(0, 32), max_size=5),
    samples_per_frame=st.integers(1, 4),
)
def test_a_rate_that_changes_costs_no_frame_beside_those_of_its_gaps(
    rate_hz, later_hz, lost, samples_per_frame
):
    """Also a rate that seems another one, because readings are lost at regular intervals."""
    steps_ns = np.repeat([1e9 / rate_hz, 1e9 / later_hz], 200)
    times_ns = np.cumsum(steps_ns).astype(int).tolist()
    kept = [time_ns for k, time_ns in enumerate(times_ns) if k < 100 or k % 33 not in lost]
    lane, line = VibrationLane(samples_per_frame=samples_per_frame), Lane()
    frame_ns = times_ns[20]
    for time_ns in kept:
        for each in (lane, line):
            each.add([SensorReading(time_ns, (1.0, 2.0, 3.0))], time_ns)
        if time_ns <= times_ns[100]:  # frames begin once the sensor's rate is known
            continue
        while (value := lane.at(frame_ns)) is not WAITING:
            ages_ns = [round(1e6 * j / samples_per_frame) for j in range(samples_per_frame)]
            if None in [line.at(frame_ns - age_ns) for age_ns in reversed(ages_ns)]:
                assert value is None
            else:
                assert value == pytest.approx((1.0, 2.0, 3.0) * samples_per_frame)
            frame_ns += 1_000_000
    assert frame_ns > kept[-1] - 20_000_000


def test_noise_is_not_amplified():
    for rate_hz in (1000, 2000, 4000, 8000):
        table = np.array(weights_for(rate_hz).rows)
        assert np.sqrt((table**2).sum(axis=1)).max() < 1.15
        assert table.sum(axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize("band", [0.0, -0.1, 0.5, math.nan])
def test_a_band_that_is_none_is_refused(band):
    with pytest.raises(ValueError, match="must lie within"):
        weights(band)
