"""A model built from a stream, update by update."""
