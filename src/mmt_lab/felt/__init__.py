"""Vibration that the operator feels, against the surface's own without a network."""
