"""The level and shape of a texture over speed, force and heading, with their error."""
