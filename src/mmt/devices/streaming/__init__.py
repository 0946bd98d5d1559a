"""Readings of several devices, each with its own clock, as one stream of frames."""
