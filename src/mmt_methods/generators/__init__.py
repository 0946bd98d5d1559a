"""Generators of vibration by other methods, learned from the strokes that we model."""
