"""Input space of a texture model, and the samples in it."""
