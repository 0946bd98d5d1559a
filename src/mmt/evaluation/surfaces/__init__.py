"""Sessions over several known surfaces: what was found of their changes, and how soon."""
