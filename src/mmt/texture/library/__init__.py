"""A first model of a surface: the likeliest texture of a library, or what a short look tells."""
