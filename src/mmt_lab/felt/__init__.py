"""What the operator feels, against what the surface would give without a network."""
