"""Acquisition boards by NI, through NI-DAQmx."""
