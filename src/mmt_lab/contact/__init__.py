"""Ways to step a tool against a stiff wall, for the experiments that compare them."""
