"""Values between the samples of a model: Delaunay triangulations and the network of paper B."""
