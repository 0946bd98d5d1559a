"""From raw values to forces, units, and what a calibration must be."""

import math
from collections import Counter
from functools import partial

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from mmt.core.errors import InputError, MmtError
from mmt.devices.ati.calibration import (
    AtiOptions,
    Calibration,
    check_calibration,
    torque_in_newton_mm,
    unit_size,
)
from mmt.devices.wrench import WrenchConverter, diagonal, matrix_of

LIMITS = (12.0, 12.0, 17.0, 120.0, 120.0, 120.0)
FOUND = Calibration("FT00017", "SI-12-0.12", "N", diagonal(1.0, 1.0), LIMITS)
SOME = st.floats(-1.5, 1.5)


def converter(matrix=None, **options):
    mounting, matrix = AtiOptions(**options), matrix or diagonal(1.0, 1.0)
    return WrenchConverter(matrix, LIMITS, mounting, Counter())


@given(
    st.lists(st.lists(SOME, min_size=6, max_size=6), min_size=6, max_size=6),
    st.lists(SOME, min_size=6, max_size=6),
    st.lists(SOME, min_size=6, max_size=6),
    st.tuples(*[st.floats(-180, 180)] * 3),
)
def test_a_force_is_the_turned_product_of_matrix_and_unbiased_values(matrix, raw, bias, angles):
    tested = converter(matrix_of(matrix), rotation_deg=angles)
    tested.take_bias([tuple(bias)], "sensor")
    force = np.array(matrix)[:3] @ (np.array(raw) - bias)
    x, y, z = np.radians(angles)
    about_x = [[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]]
    about_y = [[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]]
    about_z = [[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]]
    turn = np.array(about_z) @ about_y @ about_x
    np.testing.assert_allclose(tested.force(tuple(raw)), turn @ force, atol=1e-9)


def test_a_sensor_under_the_surface_feels_the_opposite():
    raw = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    assert converter(mounted="surface").force(raw) == (-1.0, -2.0, -3.0)


def test_overload_is_counted_by_force_and_by_torque():
    tested = converter()
    assert tested.force((0.0, 0.0, 17.5, 0.0, 0.0, 0.0)) == (0.0, 0.0, 17.5)
    assert tested.force((0.0, 0.0, 0.0, 0.0, -121.0, 0.0)) == (0.0, 0.0, 0.0)
    assert tested.force((12.0, -12.0, 17.0, 120.0, 120.0, -120.0)) is not None
    assert tested.faults["overload"] == 2


@given(
    st.lists(st.lists(SOME, min_size=6, max_size=6), min_size=6, max_size=6),
    st.lists(SOME, min_size=6, max_size=6),
    st.sampled_from([0.0, 0.5, 0.99, 1.01, 1.5, 3.0, 3.99, 4.01, 6.0, 1e200, math.inf, math.nan]),
    st.booleans(),
)
def test_what_is_beyond_the_range_is_found_for_every_matrix(matrix, direction, share, diagonally):
    """The oracle is the whole wrench, part by part."""
    matrix = np.diag(np.diag(matrix)) if diagonally else np.array(matrix)
    size = (np.abs(matrix @ direction) / LIMITS).max()
    assume(size > 1e-6)
    raw = tuple(float(share / size * each) if each else 0.0 for each in direction)
    with np.errstate(invalid="ignore"):
        shares = np.abs([sum(row * raw) for row in matrix]) / LIMITS
    largest = np.nan if np.isnan(shares).any() else shares.max()
    assume(not 1.0 - 1e-9 < largest < 1.0 + 1e-9 and not 4.0 - 1e-9 < largest < 4.0 + 1e-9)
    tested = converter(matrix_of(matrix))
    assert (tested.force(raw) is None) == (not largest <= 4.0)
    assert tested.faults["impossible value"] == (not largest <= 4.0)
    assert tested.faults["overload"] == (1.0 < largest <= 4.0)


@given(st.integers(0, 2), st.floats(0.0, 0.1))
def test_a_tool_that_moves_by_two_percent_of_the_range_gives_no_bias(axis, share):
    assume(abs(share - 0.02) > 1e-9)
    tested = converter()
    ends = [[0.5 * (k != axis) for k in range(6)] for _ in range(2)]
    ends[0][axis], ends[1][axis] = share * LIMITS[axis], -share * LIMITS[axis]
    records = [tuple(end) for end in ends] * 4
    if share < 0.02:
        tested.take_bias(records, "Nano")
        assert tested.bias == pytest.approx([0.5 * (k != axis) for k in range(6)])
    else:
        words = f"Nano: F{'xyz'[axis]} moves by .*: let the tool hang free and at rest"
        with pytest.raises(MmtError, match=words):
            tested.take_bias(records, "Nano")
        assert tested.bias == (0.0,) * 6


@pytest.mark.parametrize("rows", [[], [[1.0] * 6] * 5, [[1.0] * 5] * 6, [[1.0] * 7] * 6])
def test_a_matrix_must_be_six_by_six_and_finite(rows):
    with pytest.raises(ValueError, match=r"^it is not 6 x 6"):
        matrix_of(rows)
    with pytest.raises(ValueError, match="not finite"):
        matrix_of([*np.eye(5, 6).tolist(), [1.0] * 5 + [math.nan]])
    np.testing.assert_array_equal(diagonal(2.0, 3.0), np.diag([2.0] * 3 + [3.0] * 3))


def test_torques_are_known_by_the_names_that_boxes_use():
    for unit, newton_mm in {
        "Nm": 1000.0, "N-m": 1000.0, "N-mm": 1.0, "Nmm": 1.0, "lbf-in": 112.98482902761668,
        "lbf-ft": 1355.8179483314, "kgf-cm": 98.0665, "kN-m": 1e6,
    }.items():  # fmt: skip
        assert torque_in_newton_mm(unit, "box") == pytest.approx(newton_mm)


def test_forces_and_lengths_are_known_and_others_are_explained():
    assert unit_size("force", "lbf", "box") == pytest.approx(4.4482216152605)
    assert unit_size("force", " kgf ", "box") == 9.80665
    assert unit_size("length", "in", "box") == 25.4
    for function in (
        partial(unit_size, "force"),
        torque_in_newton_mm,
        partial(unit_size, "length"),
    ):
        with pytest.raises(InputError, match=r"box: the unit of .* 'stone' is not known"):
            function("stone", "box")


@pytest.mark.parametrize(
    ("expected", "words"),
    [
        ({"serial": "FT00018"}, "its serial number is FT00017, expected is FT00018"),
        ({"calibration": "SI-25-0.25"}, "its calibration is SI-12-0.12, expected is SI-25-0.25"),
        ({"force_unit": "lbf"}, "it measures in N, expected is lbf"),
        ({"range_n": (25, 25, 35)}, "its range is 12, 12, 17 N, expected is"),
    ],
)
def test_a_mismatch_is_explained(expected, words):
    check_calibration("box", FOUND, AtiOptions())
    given = {"serial": "ft00017", "calibration": "SI-12-0.12", "force_unit": "N"}
    check_calibration("box", FOUND, AtiOptions(**given, range_n=(12, 12, 17)))
    with pytest.raises(InputError, match=words):
        check_calibration("box", FOUND, AtiOptions(**given | expected))
