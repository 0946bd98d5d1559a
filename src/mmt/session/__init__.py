"""Recorded sessions: write, read, replay, import, export and recover them."""
