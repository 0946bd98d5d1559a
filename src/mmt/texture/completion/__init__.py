"""When a model is good enough to render from, and when modelling ends."""
