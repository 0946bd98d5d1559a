"""The store of models."""
