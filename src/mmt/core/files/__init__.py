"""Files: whole when written, checked when read."""
