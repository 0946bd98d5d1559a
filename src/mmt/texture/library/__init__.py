"""A library of known textures: the likeliest one for a surface, and its blend with new samples."""
