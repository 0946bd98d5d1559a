"""Texture models of other programs, and vibration as files of sound and of haptics."""
