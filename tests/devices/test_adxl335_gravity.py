"""Calibration by gravity: what was put in comes out, and each mistake is told apart."""

import math

import numpy as np
import pytest
from hypothesis import given
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


def felt(up: str) -> list[float]:
    return [GRAVITY_M_S2 * (up[1] == axis) * (1 if up[0] == "+" else -1) for axis in "xyz"]


def rest(up: str, true: GravityCalibration = TRUE, acceleration=None, spread=STILL) -> Rest:
    a = felt(up) if acceleration is None else acceleration
    x, y, z = (true.zero_v[i] + true.gain_v_per_m_s2[i] * a[i] for i in range(3))
    return Rest(up, (x, y, z), spread)


zeros = st.tuples(*[st.floats(1.4, 1.9)] * 3)
gains = st.tuples(*[st.floats(0.0285, 0.0385)] * 3)


@given(zeros, gains, st.permutations(UPS), st.integers(4, 6))
def test_what_was_put_in_comes_out(zero, gain, ups, number) -> None:
    true = GravityCalibration(zero, gain)
    if {up[1] for up in ups[:number]} != set("xyz"):
        number = 6
    found = calibrate([rest(up, true) for up in ups[:number]], 3.3)
    assert found.zero_v == pytest.approx(zero, abs=1e-9)
    assert found.gain_v_per_m_s2 == pytest.approx(gain, rel=1e-9)
    assert found.residual_m_s2 < 1e-6


def test_three_orientations_are_enough() -> None:
    found = calibrate([rest(up) for up in ("+x", "-y", "+z")], 3.3)
    assert found.gain_v_per_m_s2 == pytest.approx(TRUE.gain_v_per_m_s2)


def test_noise_is_averaged_as_least_squares_does() -> None:
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


def refused(rests: list[Rest], supply_v: float = 3.3) -> str:
    with pytest.raises(InputError) as caught:
        calibrate(rests, supply_v)
    return str(caught.value)


def six() -> dict[str, Rest]:
    return {up: rest(up) for up in UPS}


def test_an_axis_without_a_rest_is_named() -> None:
    assert "no rest with z up or down" in refused([rest("+x"), rest("-x"), rest("+y")])
    assert "x, y, z" in refused([])


def test_a_sensor_that_moved_is_told() -> None:
    moved = six() | {"-y": rest("-y", spread=(0.002, 0.1, 0.002))}
    assert "with -y up the sensor was not at rest (it varied by 0.30 g)" in refused(
        [*moved.values()]
    )
    unknown = six() | {"-y": rest("-y", spread=(math.nan,) * 3)}
    assert "with -y up" in refused([*unknown.values()])


def test_swapped_orientations_are_told() -> None:
    swapped = six()
    swapped["+x"] = Rest("+x", rest("+y").mean_v, STILL)
    assert "named +x up looks like +y up" in refused([*swapped.values()])
    swapped = six()
    swapped["+z"] = Rest("+z", rest("-z").mean_v, STILL)
    assert "named +z up looks like -z up" in refused([*swapped.values()])


def test_a_slant_is_told() -> None:
    a = math.radians(12)
    slant = [GRAVITY_M_S2 * math.cos(a), GRAVITY_M_S2 * math.sin(a), 0.0]
    message = refused([*(six() | {"+x": rest("+x", acceleration=slant)}).values()])
    assert "with +x up, y is" in message
    assert "at a slant" in message


def test_another_supply_than_the_options_say_is_told() -> None:
    assert "check the options for supply" in refused([*six().values()], supply_v=2.0)
    far = GravityCalibration((2.3, 1.65, 1.65), nominal(3.3).gain_v_per_m_s2)
    assert "2.300 V at zero g" in refused([rest(up, far) for up in UPS])


def test_what_changed_is_told_by_axis() -> None:
    assert changes(TRUE, TRUE) == []
    other = GravityCalibration((1.60, 1.75, 1.75), (0.0345, 0.033, 0.0335))
    about_y, about_z = changes(other, TRUE)
    assert about_y.startswith("y: zero moved by +2.12 m/s2")
    assert about_z.startswith("z: zero moved by +0.00 m/s2, gain by +3.1 %")


def test_what_is_stored_comes_back() -> None:
    assert from_dict(TRUE.as_dict()) == TRUE


@pytest.mark.parametrize(
    "content",
    [
        {},
        TRUE.as_dict() | {"zero_v": [1, 2]},
        TRUE.as_dict() | {"zero_v": [1, 2, math.nan]},
        TRUE.as_dict() | {"gain_v_per_m_s2": [0.03, 0.0, 0.03]},
        TRUE.as_dict() | {"gain_v_per_m_s2": "abc"},
    ],
)
def test_a_stored_calibration_is_not_trusted(content) -> None:
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
def test_recorded_rests_are_not_trusted(content) -> None:
    with pytest.raises(InputError):
        rests_from(content)
