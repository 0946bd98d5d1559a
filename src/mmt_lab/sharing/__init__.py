"""Listeners without hands, to measure what sharing a model costs."""
