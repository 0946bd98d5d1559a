from functools import partial

import autoregressive_oracles as oracles
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mmt.core.errors import InputError
from mmt.texture.autoregression.forms import (
    ar_to_reflection,
    lsf_output_power,
    lsf_to_ar,
    lsf_to_reflection,
    reflection_to_ar,
    reflection_to_lsf,
)
from mmt.texture.autoregression.lsf import lsf_inverse_gain

ORDERS = [1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 29, 30, 63, 64]
SHAPES = {
    "even": lambda order: np.pi / (order + 1) * np.arange(1, order + 1),
    "uneven": oracles.spread_lsf,
    "low-pass": oracles.low_pass_lsf,
    "high-pass": lambda order: np.pi - oracles.low_pass_lsf(order)[::-1],
}
ONE = 1 - 2.0**-53

reflection_arrays = st.integers(1, 64).flatmap(
    lambda order: hnp.arrays(
        np.float64, order, elements=st.sampled_from([ONE, -ONE, 0.0, 1e-300]) | st.floats(-ONE, ONE)
    )
)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", ORDERS)
def test_every_direction_against_many_digits(order, shape):
    lsf = SHAPES[shape](order)
    ar = oracles.lsf_to_ar(lsf)
    reflection = oracles.step_down(ar)
    largest = float(max(1, *(abs(a) for a in ar)))
    rounded = np.array([float(k) for k in reflection])
    assert oracles.largest_error(lsf_to_ar(lsf), ar) < 3e-14 * largest
    assert oracles.largest_error(lsf_to_reflection(lsf), reflection) < 2e-14
    np.testing.assert_allclose(reflection_to_lsf(rounded), lsf, rtol=0, atol=2e-15)
    exact = oracles.step_up(oracles.exact(rounded))
    assert oracles.largest_error(reflection_to_ar(rounded), exact) < 1e-13 * largest
    gain = lsf_inverse_gain(lsf, np.empty(2 * order))
    assert oracles.relative_error(gain, oracles.inverse_gain(reflection)) < 1e-14


@pytest.mark.parametrize("order", [1, 2, 3, 4, 7, 10, 12])
def test_frequencies_are_the_angles_of_polynomial_roots(order):
    reflection = np.random.default_rng(order).uniform(-0.95, 0.95, order)
    found = reflection_to_lsf(reflection)
    expected = oracles.refine_lsf(oracles.step_up(oracles.exact(reflection)), found)
    assert oracles.largest_error(found, expected) < 2e-15
    through_ar = reflection_to_lsf(ar_to_reflection(reflection_to_ar(reflection)))
    assert oracles.largest_error(through_ar, expected) < 1e-9


@pytest.mark.parametrize("sign", [-1, 1])
def test_poles_at_the_unit_circle_keep_relative_accuracy(sign):
    reflection = sign * np.array([ONE, 0.3, -0.999999, 0.2, 0.99999])
    found = reflection_to_lsf(reflection)
    expected = oracles.refine_lsf(oracles.step_up(oracles.exact(reflection)), found)
    for a, b in zip(found, expected, strict=True):
        assert oracles.relative_error(a, b) < 1e-14 or abs(a - float(b)) < 1e-15


@given(
    reflection=st.integers(1, 64).flatmap(
        lambda order: hnp.arrays(np.float64, order, elements=st.floats(-0.3, 0.3))
    )
)
@settings(max_examples=80)
def test_round_trip_from_reflection(reflection):
    lsf = reflection_to_lsf(reflection)
    gap = np.diff(lsf, prepend=0, append=np.pi).min()
    np.testing.assert_allclose(lsf_to_reflection(lsf), reflection, atol=1e-13 / gap)
    loss = np.prod((1 + np.abs(reflection)) / (1 - np.abs(reflection)))
    if loss < 1e12:
        np.testing.assert_allclose(
            ar_to_reflection(reflection_to_ar(reflection)), reflection, atol=1e-15 * loss
        )


@given(reflection=reflection_arrays)
@settings(max_examples=200)
def test_frequencies_of_every_stable_filter_ascend_inside_the_half_circle(reflection):
    lsf = reflection_to_lsf(reflection)
    assert (np.diff(lsf, prepend=0, append=np.pi) > 0).all()
    assert np.isfinite(lsf_to_ar(lsf)).all()


SMALL = np.random.default_rng(2).uniform(-0.15, 0.15, (6, 9))
SPREAD = np.array([oracles.spread_lsf(9, seed) for seed in range(6)])


@pytest.mark.parametrize(
    ("convert", "rows"),
    [
        *((convert, SMALL) for convert in (reflection_to_ar, ar_to_reflection, reflection_to_lsf)),
        *((convert, SPREAD) for convert in (lsf_to_ar, lsf_to_reflection)),
    ],
)
def test_a_batch_is_its_rows(convert, rows):
    batch = convert(rows)
    for row, result in zip(rows, batch, strict=True):
        np.testing.assert_array_equal(convert(row), result)
    assert convert(rows[:0]).shape == (0, 9)
    np.testing.assert_array_equal(convert(np.asfortranarray(rows)), batch)


@pytest.mark.parametrize(
    ("convert", "values", "words"),
    [
        (reflection_to_lsf, [0.2, 1.0], "magnitude"),
        (reflection_to_ar, [0.2, -1.5], "magnitude"),
        (reflection_to_lsf, [0.2, np.nan], "not finite"),
        (reflection_to_lsf, [], "shape"),
        (reflection_to_lsf, np.zeros(65), "shape"),
        (reflection_to_lsf, np.zeros((2, 2, 2)), "shape"),
        (lsf_to_ar, [0.5, 0.5], "ascend"),
        (lsf_to_ar, [0.0, 0.5], "ascend"),
        (lsf_to_reflection, [0.5, np.pi], "ascend"),
        (lsf_to_reflection, [0.7, 0.5], "ascend"),
        *((ar_to_reflection, ar, "stable") for ar in ([1.0], [-1.1], [0.0, 1.5], [2.1, 0.9])),
        (ar_to_reflection, lsf_to_ar(oracles.low_pass_lsf(30)), "stable"),
        (ar_to_reflection, [np.nan, 0.2], "not finite"),
    ],
)
def test_what_is_no_filter_is_said(convert, values, words):
    with pytest.raises(InputError, match=words):
        convert(np.array(values))


@pytest.mark.parametrize(("order", "least"), [(4, 0.9), (8, 0.9), (16, 0.0), (16, 0.9), (24, 0.5)])
def test_frequencies_tell_their_own_filter_and_that_before_by_their_least_gap(order, least):
    random = np.random.default_rng(order)
    for _ in range(4):
        reflection = random.uniform(least, 1 - 1e-6, order) * random.choice([-1.0, 1.0], order)
        lsf = reflection_to_lsf(reflection)
        found = lsf_to_reflection(lsf)
        exact = oracles.step_down(oracles.lsf_to_ar(lsf))
        assert oracles.largest_error(found, exact) < 1e-11
        gap = np.diff(lsf, prepend=0.0, append=np.pi).min()
        changed = np.abs(found - reflection) / (1 - np.abs(reflection))
        assert gap < 1e-14 or changed.max() < 4e-15 / gap
        assert (np.abs(found) < 1.0).all()


def test_arrays_that_cannot_be_written_are_taken():
    reflection = np.array([[0.5, -0.3, 0.2], [0.1, 0.2, 0.3]])
    lsf = reflection_to_lsf(reflection)
    power = partial(lsf_output_power, np.ones(2))
    for convert, values in (
        (reflection_to_lsf, reflection),
        (reflection_to_ar, reflection),
        (ar_to_reflection, reflection_to_ar(reflection)),
        (lsf_to_reflection, lsf),
        (lsf_to_ar, lsf),
        (power, lsf),
    ):
        expected = convert(values.copy())
        values.setflags(write=False)
        np.testing.assert_array_equal(convert(values), expected)
