"""Commands of the bridges."""
