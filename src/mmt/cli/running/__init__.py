"""Run services from a command line, and show how they run."""
