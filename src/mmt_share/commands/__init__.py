"""Commands of sharing and of the player."""
