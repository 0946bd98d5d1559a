"""The command lines of the laboratory."""
