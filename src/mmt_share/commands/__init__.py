"""Commands of what is shared."""
