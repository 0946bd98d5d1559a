"""``mmt scene``: what a scene runs, sends, imports and costs."""
