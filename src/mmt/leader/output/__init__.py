"""Vibration: the stream, the model's, and which of them is played."""
