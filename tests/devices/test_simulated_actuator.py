"""The simulated actuator limits, counts and keeps nothing else."""

import math

import numpy as np
import pytest

from mmt.core.errors import InputError
from mmt.testing.simulation.actuator import SimulatedActuator


def test_statistics_of_lists_and_arrays():
    actuator = SimulatedActuator(limit_m_s2=2.0)
    actuator.connect()
    actuator.write([1.0, -1.0])
    actuator.write(np.array([3.0, -5.0]))
    actuator.write([])
    statistics = actuator.statistics
    assert statistics.samples == 4
    assert statistics.clipped == 2
    assert statistics.peak_m_s2 == 5.0
    assert statistics.rms_m_s2 == pytest.approx(math.sqrt((1 + 1 + 4 + 4) / 4))


def test_a_sample_at_the_limit_is_not_clipped():
    actuator = SimulatedActuator(limit_m_s2=2.0)
    actuator.write([2.0, -2.0])
    assert actuator.statistics.clipped == 0


def test_connect_starts_anew_and_close_keeps_the_figures():
    actuator = SimulatedActuator(limit_m_s2=2.0)
    assert actuator.statistics.rms_m_s2 == 0.0
    actuator.write([1.0])
    actuator.close()
    actuator.close()
    assert actuator.statistics.samples == 1
    actuator.connect()
    actuator.calibrate()
    assert actuator.statistics.samples == 0


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_bad_limits_are_refused(limit):
    with pytest.raises(InputError, match="limit_m_s2"):
        SimulatedActuator(limit_m_s2=limit)
