"""Values between the samples of a model: Delaunay triangulations and radial basis networks."""
