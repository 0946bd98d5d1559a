"""A hub: takes a leader's shared model once and serves it to any number of listeners."""
