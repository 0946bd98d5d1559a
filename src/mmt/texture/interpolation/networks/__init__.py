"""The radial basis function network of paper B."""
