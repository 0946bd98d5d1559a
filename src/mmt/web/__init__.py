"""Pages in a browser: the live monitor, the texture player, and the view of a recording."""
