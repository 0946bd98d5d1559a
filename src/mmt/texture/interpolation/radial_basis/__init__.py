"""Radial basis function networks (paper B)."""
