"""Level of a texture over speed, force and heading, with its error; smoothed filter shapes."""
