"""Numerical stability where it is stiff and extreme: cases that hold, or do not."""
