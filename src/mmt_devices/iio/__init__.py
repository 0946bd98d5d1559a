"""Accelerometers of Linux's industrial I/O (IIO)."""
