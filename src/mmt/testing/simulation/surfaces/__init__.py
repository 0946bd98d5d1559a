"""Surfaces whose texture is known exactly, and their vibration under a hand."""
