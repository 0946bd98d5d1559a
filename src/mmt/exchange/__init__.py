"""Texture models of other programs, and vibration as sound files."""
