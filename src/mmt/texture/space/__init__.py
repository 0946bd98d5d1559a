"""What a texture is a function of, and the samples that are measured of it."""
