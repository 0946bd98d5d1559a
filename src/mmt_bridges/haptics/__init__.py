"""Vibration as files: MPEG haptics, Apple's patterns."""
