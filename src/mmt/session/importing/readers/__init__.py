"""Readers of other programs' files: a module for each kind, and what they share."""
