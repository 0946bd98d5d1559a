"""Devices in software that speak the real ones' protocols, to try drivers and scenes on."""

from collections.abc import Callable

from mmt.devices.protocols import Vector

Truth = Callable[[int], Vector]
"""What an emulated device measures: a vector in the channel's unit, at a time (ns) of the host's
monotonic clock."""
