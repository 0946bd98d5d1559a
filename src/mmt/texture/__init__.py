"""Numerics of haptic texture: arrays in, arrays out; no module is loaded before its use."""
