"""``mmt scene``: describe and measure what a scene runs, sends, imports and costs."""
