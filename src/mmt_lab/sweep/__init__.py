"""Sessions evaluated with every combination of settings."""
