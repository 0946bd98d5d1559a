"""Vibration from a model, and the concealment of gaps."""
