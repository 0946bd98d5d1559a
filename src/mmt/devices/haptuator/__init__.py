"""Haptuators, and other voice-coil actuators that an amplifier drives."""
