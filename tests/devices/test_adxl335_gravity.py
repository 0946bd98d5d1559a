"""Calibration by gravity: what was put in comes out, and each mistake is told apart."""

import math
import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mmt.core.errors import InputError
from mmt.devices.adxl335.gravity import (
    GRAVITY_M_S2,
    UPS,
    GravityCalibration,
    Rest,
    calibrate,
    changes,
    from_dict,
    nominal,
    rests_from,
)

TRUE = GravityCalibration((1.60, 1.68, 1.75), (0.0345, 0.033, 0.0325))
STILL = (0.002, 0.002, 0.003)


def felt(up):
    return [GRAVITY_M_S2 * (up[1] == axis) * (1 if up[0] == "+" else -1) for axis in "xyz"]


def rest(up, true=TRUE, acceleration=None, spread=STILL):
    a = felt(up) if acceleration is None else acceleration
    x, y, z = (true.zero_v[i] + true.gain_v_per_m_s2[i] * a[i] for i in range(3))
    return Rest(up, (x, y, z), spread)


zeros = st.tuples(*[st.floats(1.4, 1.9)] * 3)
gains = st.tuples(*[st.floats(0.0285, 0.0385)] * 3)


@given(zeros, gains, st.permutations(UPS), st.integers(3, 6))
def test_what_was_put_in_comes_out_of_three_orientations_and_more(zero, gain, ups, number):
    true = GravityCalibration(zero, gain)
    if {up[1] for up in ups[:number]} != set("xyz"):
        number = 6
    found = calibrate([rest(up, true) for up in ups[:number]], 3.3)
    assert found.zero_v == pytest.approx(zero, abs=1e-9)
    assert found.gain_v_per_m_s2 == pytest.approx(gain, rel=1e-9)
    assert found.residual_m_s2 < 1e-6


def test_noise_is_averaged_as_least_squares_does():
    generator = np.random.default_rng(4)
    rests = [
        Rest(r.up, tuple(np.array(r.mean_v) + generator.normal(0, 0.004, 3)), STILL)
        for up in UPS
        for r in [rest(up)] * 4
    ]
    found = calibrate(rests, 3.3)
    for axis in range(3):
        design = np.array([[1.0, felt(r.up)[axis]] for r in rests])
        volts = np.array([r.mean_v[axis] for r in rests])
        (zero, gain), *_ = np.linalg.lstsq(design, volts, rcond=None)
        assert found.zero_v[axis] == pytest.approx(zero)
        assert found.gain_v_per_m_s2[axis] == pytest.approx(gain)
    assert 0.0 < found.residual_m_s2 < 1.0


def refused(rests, supply_v=3.3):
    with pytest.raises(InputError) as caught:
        calibrate(rests, supply_v)
    return str(caught.value)


def six():
    return {up: rest(up) for up in UPS}


def test_an_axis_without_a_rest_and_a_sensor_that_moved_are_named():
    assert "no rest with z up or down" in refused([rest("+x"), rest("-x"), rest("+y")])
    assert "x, y, z" in refused([])
    for spread, told in (((0.002, 0.1, 0.002), " (it varied by 0.30 g)"), ((math.nan,) * 3, "")):
        moved = six() | {"-y": rest("-y", spread=spread)}
        assert f"with -y up the sensor was not at rest{told}" in refused([*moved.values()])


@pytest.mark.parametrize(("named", "true"), [("+x", "+y"), ("+z", "-z")])
def test_swapped_orientations_are_told(named, true):
    swapped = six() | {named: Rest(named, rest(true).mean_v, STILL)}
    assert f"named {named} up looks like {true} up" in refused([*swapped.values()])


def test_a_slant_is_told():
    def slanted(degrees):
        x, y = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        slant = [GRAVITY_M_S2 * x, GRAVITY_M_S2 * y, 0.0]
        return [*(six() | {"+x": rest("+x", acceleration=slant)}).values()]

    # the line of six rests takes a sixth of what one is off
    residual = calibrate(slanted(6.8), 3.3).residual_m_s2
    assert residual == pytest.approx(5 / 6 * GRAVITY_M_S2 * math.sin(math.radians(6.8)))
    message = refused(slanted(7.0))
    assert "with +x up, y is 1.00 m/s2 off its line" in message
    assert "at a slant" in message


def test_another_supply_than_the_options_say_is_told():
    message = refused([*six().values()], supply_v=2.0)
    assert "x gives 0.338 V per g where a supply of 2 V means 0.200: check the options" in message
    far = GravityCalibration((2.3, 1.65, 1.65), nominal(3.3).gain_v_per_m_s2)
    assert "2.300 V at zero g where a supply of 3.3 V means 1.650: check" in refused(
        [rest(up, far) for up in UPS]
    )


def changed(axis, off_g, gain):
    """Return the data sheet's values with another zero and gain of one axis."""
    zero_v, gains = map(list, nominal(3.3)[:2])
    zero_v[axis] += 0.33 * off_g
    gains[axis] *= gain
    return GravityCalibration(tuple(zero_v), tuple(gains))


axes = st.integers(0, 2)


@given(
    axes,
    st.tuples(st.floats(-2.0, 2.0), st.just(1.0), st.just(0.0))
    | st.tuples(st.just(0.0), st.floats(0.5, 1.5), st.just(0.0))
    | st.tuples(st.just(0.0), st.just(1.0), st.floats(0.0, 0.2)),
)
def test_a_zero_a_gain_and_a_tremor_have_their_bounds(axis, case):
    off_g, gain, tremor_g = case
    beyond = max(abs(off_g) / 1.2, abs(gain - 1.0) / 0.2, tremor_g / 0.1)
    assume(abs(beyond - 1.0) > 1e-9)
    spread = tuple(0.33 * tremor_g if axis == k else 0.0 for k in range(3))
    rests = [rest(up, changed(axis, off_g, gain), spread=spread) for up in UPS]
    if beyond < 1.0:
        assert calibrate(rests, 3.3).residual_m_s2 < 1e-6
    else:
        assert re.search(f"^{'xyz'[axis]} gives|was not at rest", refused(rests))


@given(axes, st.floats(-1.0, 1.0), st.floats(0.96, 1.04), st.booleans())
def test_a_change_is_told_from_half_a_metre_or_two_percent(axis, zero_m_s2, gain, of_gain):
    zero_m_s2, gain = (0.0, gain) if of_gain else (zero_m_s2, 1.0)
    assume(abs(abs(zero_m_s2) - 0.5) > 1e-9 and abs(abs(gain - 1.0) - 0.02) > 1e-9)
    told = changes(changed(axis, zero_m_s2 / GRAVITY_M_S2, gain), nominal(3.3))
    assert len(told) == (abs(zero_m_s2) > 0.5 or abs(gain - 1.0) > 0.02)
    assert all(sentence.startswith(f"{'xyz'[axis]}: zero moved by") for sentence in told)


def test_what_changed_is_told_by_axis():
    assert changes(TRUE, TRUE) == []
    other = GravityCalibration((1.60, 1.75, 1.75), (0.0345, 0.033, 0.0335))
    about_y, about_z = changes(other, TRUE)
    assert about_y.startswith("y: zero moved by +2.12 m/s2")
    assert about_z.startswith("z: zero moved by +0.00 m/s2, gain by +3.1 %")


def test_what_is_stored_comes_back():
    edges = GravityCalibration((-999.0, 0.0, 999.0), (2e-6, 1.0, 999.0), 0.5)
    for stored in (TRUE, nominal(3.3), edges):
        assert from_dict(stored.as_dict()) == stored
    rests = [*six().values()]
    assert rests_from([each._asdict() for each in rests]) == rests


@pytest.mark.parametrize(
    "content",
    [
        {},
        TRUE.as_dict() | {"zero_v": [1, 2]},
        TRUE.as_dict() | {"zero_v": [1, 2, math.nan]},
        TRUE.as_dict() | {"zero_v": [1, -1000.0, 2]},
        TRUE.as_dict() | {"gain_v_per_m_s2": [0.03, 1e-6, 0.03]},
        TRUE.as_dict() | {"gain_v_per_m_s2": [0.03, 0.03, 1000.0]},
        TRUE.as_dict() | {"gain_v_per_m_s2": "abc"},
    ],
)
def test_a_stored_calibration_is_not_trusted(content):
    with pytest.raises(InputError, match="calibrate again"):
        from_dict(content)


@pytest.mark.parametrize(
    "content",
    [
        None,
        [1],
        [{"up": "+x"}],
        [{"up": "up", "mean_v": [1, 2, 3], "spread_v": [0, 0, 0]}],
        [{"up": "+x", "mean_v": [1, 2, math.inf], "spread_v": [0, 0, 0]}],
    ],
)
def test_recorded_rests_are_not_trusted(content):
    with pytest.raises(InputError, match=r"rests must be a list of|'up' must be one of"):
        rests_from(content)
