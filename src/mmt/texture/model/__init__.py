"""The texture model: its samples, its inputs, its file, and a warm start from known ones."""
