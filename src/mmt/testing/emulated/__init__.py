"""Devices in software that use the protocols of the real ones, to test drivers and scenes."""

from collections.abc import Callable

from mmt.devices.protocols import Vector

Truth = Callable[[int], Vector]
"""What an emulated device measures: a vector in the channel's unit, at a time (ns) of the host's
monotonic clock."""
