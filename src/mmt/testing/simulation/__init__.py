"""Devices that need no hardware: a hand, a robot on a known texture, sensors, an actuator.

Plain Python and NumPy: a simulated follower starts at once and stays small.
"""

from typing import Final

RATE_HZ: Final = 1000.0
"""Every simulated device ticks at the frame's rate."""

PERIOD_S: Final = 1.0 / RATE_HZ

PERIOD_NS: Final = 1_000_000
