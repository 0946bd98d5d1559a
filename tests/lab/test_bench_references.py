"""The references with many digits, against answers that are known by hand."""

import numpy as np
import pytest

from mmt_lab.bench import references


def test_the_residual_is_the_mean_square_of_both_prediction_errors():
    # forward 2 - 1, 4 - 2; backward 1 - 2, 2 - 4
    x, ar = np.array([1.0, 2.0, 4.0]), references.exact([-1.0])
    assert float(references.residual(x, ar)) == pytest.approx((1 + 4 + 1 + 4) / 4)


def test_steps_up_and_down_are_inverse():
    k = references.exact([0.5, -0.9, 0.999999, 0.1])
    back = references.step_down(references.step_up(k))
    assert references.largest_error(np.array(k, float), back) < 1e-100
    assert references.step_down(references.exact([0.2, 1.0])) is None


def test_stability_is_that_of_exactly_these_coefficients():
    assert references.is_stable(np.array([-1.9, 0.95]))
    assert not references.is_stable(np.array([-2.0, 1.0]))
    assert not references.is_stable(np.array([0.0, 1.5]))
    assert not references.is_stable(np.array([np.nan, 0.1]))


@pytest.mark.parametrize("order", [1, 2, 5, 8])
def test_line_spectral_frequencies_are_found_again(order):
    lsf = np.pi / (order + 1) * (np.arange(1, order + 1) + 0.2 * np.sin(np.arange(order)))
    ar = references.lsf_to_ar(lsf)
    found = references.refine_lsf(ar, lsf + 1e-3)
    assert found is not None
    assert references.largest_error(lsf, found) < 1e-50


def test_an_incomplete_set_of_frequencies_is_refused():
    lsf = np.array([0.5, 1.0, 1.5, 2.0])
    ar = references.lsf_to_ar(lsf)
    assert references.refine_lsf(ar, np.array([0.5, 1.0, 0.5, 2.0])) is None
