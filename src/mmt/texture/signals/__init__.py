"""Filters, alignment, spectra of signals, and DFT321."""
