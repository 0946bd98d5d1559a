"""Autoregressive models: Burg's method, line spectral frequencies, lattice filters."""
