"""Listeners that render nothing, to measure the cost of sharing a model."""
