"""Acquisition boards by NI, by NI-DAQmx."""
