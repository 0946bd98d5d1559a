"""The experiments of the laboratory, one module each, which ``mmt lab`` finds by itself."""
