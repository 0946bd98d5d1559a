"""What an emulated device measures."""

from collections.abc import Callable

from mmt.devices.protocols import Vector

Truth = Callable[[int], Vector]
"""The physical truth at a time: a vector in the channel's unit, ns of the host's monotonic
clock."""
