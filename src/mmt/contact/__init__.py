"""Numerics of contact: arrays and numbers in, numbers out; no files, no clock."""
