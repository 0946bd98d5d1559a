"""Generators of vibration by other methods, learned from the same strokes as our model."""
