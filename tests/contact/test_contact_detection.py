"""When a tool touches, by the force on it and the way it moves."""

import math
from itertools import pairwise

import pytest

from mmt.contact.estimation import ContactEstimator, EstimationSettings

Segment = tuple[float, float]
"""Speed into the surface (mm/s) and force (N), held for 0.1 s."""


def touches(estimator, *segments):
    """Return whether the tool touches at the end of each segment."""
    found, depth_m = [], 0.0
    for speed_mm_s, force_n in segments:
        for _ in range(100):
            depth_m += speed_mm_s * 1e-6
            estimator.update(depth_m, force_n)
        found.append(estimator.contact)
    return found


@pytest.mark.parametrize("contact_n", [0.2, 2.0])
@pytest.mark.parametrize(
    ("segments", "expected"),
    [
        # above the threshold, until below half of it
        ([(0, 0.19), (0, 0.21), (0, 0.11), (-9, 0.11), (0, 0.09), (0, 0.19), (0, 0.21)], "0111001"),
        # not while it moves outward, nor then until it moves inward
        ([(-9, 0), (-9, 0.5), (0, 0.5), (0.5, 0.5), (0.5, 0.15), (2, 0.15)], "000001"),
        ([(-9, 0), (-9, 0.5), (0, 0), (0, 0.5)], "0001"),
        ([(-0.5, 0), (-0.5, 0.5)], "01"),
        ([(0, 0.2)], "0"),
        ([(2, 0.15)], "0"),
        # above recent pulls, if they are not small beside the largest force
        ([(0, 8), (0, -1), (0, 1.2), (0, 1.3)], "1001"),
        ([(0, 8), (0, -1), *50 * [(0, 0)], (0, 0.43), (0, 0.48)], "10" + 50 * "0" + "01"),
        ([(0, 2), (0, -1), (0, 0.45), (0, 0.55)], "1001"),
        ([(0, 8), (0, 0), (0, 0.21)], "101"),
    ],
)
def test_contact_begins_and_ends_at_its_threshold(contact_n, segments, expected):
    estimator = ContactEstimator(EstimationSettings(contact_n))
    scaled = [(speed, force * (contact_n / 0.2)) for speed, force in segments]
    wanted = [digit == "1" for digit in expected]
    assert touches(estimator, *scaled) == wanted
    assert estimator.contacts == wanted[0] + sum(b > a for a, b in pairwise(wanted))


def test_force_is_filtered_with_3_ms():
    estimator = ContactEstimator()
    assert estimator.contact is False
    estimator.update(0.0, -1.0)
    for _ in range(4):
        estimator.update(0.0, 1.0)
    assert estimator.largest_n == pytest.approx(1.0 - 2.0 * math.exp(-4 / 3))
    estimator.update(0.0, -1.0)
    assert estimator.largest_n == pytest.approx(1.0 - 2.0 * math.exp(-4 / 3))
