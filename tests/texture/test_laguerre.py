"""Searches of line spectral frequencies where zeros crowd, against counts in many digits."""

import itertools

import mpmath
import numpy as np
import pytest

from mmt.texture.autoregression.forms import reflection_to_lsf

ONE = 1 - 2.0**-53
LEAST = 2.0**-99
"""Frequencies below are moved up, apart from each other."""
ROUNDINGS = 16 * 2.0**-53
ORDERS = [1, 2, 3, 4, 5, 8, 16, 17, 33, 64]


def zeros_below(reflection, frequency, of_p):
    """Return how many zeros P (or Q) has below, by Sturm's theorem in sin(w/2)."""
    order = len(reflection)
    mirrored = [
        -mpmath.mpf(float(k)) if j % 2 == 0 else mpmath.mpf(float(k))
        for j, k in enumerate(reflection)
    ]
    sign = 1 if of_p == (order % 2 == 1) else -1
    before = [mpmath.mpf(sign), *(sign * k for k in mirrored)]
    squares = [(1 - k) * (1 + b) for b, k in itertools.pairwise(before)]
    t = 2 * mpmath.sin(frequency / 2)
    values = [mpmath.mpf(1), t]
    for square in squares[0 if sign == 1 else 1 :]:
        values.append(t * values[-1] - square * values[-2])
    changes = sum((a < 0) != (b < 0) for a, b in itertools.pairwise(values))
    return (order + 1 if of_p else order) // 2 - changes


def assert_accurate(reflection):
    """Hold each frequency relative to itself, and near pi to what floats tell."""
    lsf = reflection_to_lsf(reflection)
    assert (np.diff(lsf, prepend=0, append=np.pi) > 0).all()
    with mpmath.workdps(50):
        for number, found in enumerate(lsf):
            if found < LEAST:
                continue
            frequency = mpmath.mpf(float(found))
            error = ROUNDINGS * (frequency if found < 2 else 4)
            low, high = frequency - error, frequency + error
            of_p = number % 2 == 0
            assert zeros_below(reflection, low, of_p) <= number // 2
            if high < mpmath.pi:
                assert zeros_below(reflection, high, of_p) > number // 2


def near_one(generator, order):
    signs = generator.choice([-1, 1], order)
    return signs * np.minimum(1 - 10.0 ** generator.uniform(-15.9, -1, order), ONE)


CROWDS = {
    "ordinary": lambda generator, order: generator.uniform(-0.95, 0.95, order),
    "near one": near_one,
    "one or nothing": lambda generator, order: generator.choice([ONE, -ONE, 0, 0.5], order),
    "alternately one": lambda _, order: ONE * (-1.0) ** np.arange(order),
    "alternately minus one": lambda _, order: -ONE * (-1.0) ** np.arange(order),
    "all one": lambda _, order: np.full(order, ONE),
    "all minus one": lambda _, order: np.full(order, -ONE),
    "one in the middle": lambda generator, order: np.where(
        np.arange(order) == order // 2, ONE, generator.uniform(-0.5, 0.5, order)
    ),
    "white": lambda _, order: np.zeros(order),
}


@pytest.mark.parametrize("crowd", CROWDS)
@pytest.mark.parametrize("order", ORDERS)
def test_every_frequency_is_the_zero_of_its_number(order, crowd):
    assert_accurate(CROWDS[crowd](np.random.default_rng(order), order))


@pytest.mark.parametrize(
    "reflection",
    [
        [-0.99999999, -ONE, ONE, ONE],
        [0, ONE, ONE, 1e-300, 0.5, 1e-300, -ONE, -ONE, 0.5, 1e-300, ONE, 0.5, 0.5],
        [ONE, -ONE, -ONE, -0.9996634, -0.99999999],
        [0, 0.5, 0, ONE, -ONE, 0.5, -ONE, ONE, 0.5, 0, ONE, -ONE],
    ],
    ids=["tiny pair", "doubles at the middle", "from far off", "doubles at a start"],
)
def test_crowds_closer_than_roundings_are_counted_out(reflection):
    assert_accurate(np.array(reflection))


def test_what_one_filter_finds_does_not_depend_on_the_others():
    generator = np.random.default_rng(5)
    rows = np.array([near_one(generator, 13) for _ in range(7)])
    rows[::2] = generator.uniform(-0.9, 0.9, (4, 13))
    together = reflection_to_lsf(rows)
    for row, found in zip(rows, together, strict=True):
        np.testing.assert_array_equal(reflection_to_lsf(row), found)
