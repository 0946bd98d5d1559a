"""The texture model: its samples, its inputs and its file."""
