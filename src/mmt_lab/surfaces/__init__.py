"""Sessions over several known surfaces, and how well changes are found in them."""
