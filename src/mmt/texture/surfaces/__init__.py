"""Detection of changes of surface, and a model for each surface."""
