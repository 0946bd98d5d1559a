"""Hardware beyond that of the papers: drivers, each with its emulator beside it."""
