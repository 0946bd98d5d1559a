"""The emulated network between follower and leader."""
