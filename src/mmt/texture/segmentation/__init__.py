"""Stationary segments of a stream."""
