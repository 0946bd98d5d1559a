"""Evaluations of recorded sessions, measurements, and reports."""
