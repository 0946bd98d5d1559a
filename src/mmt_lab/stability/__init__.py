"""The stiff and extreme cases of ``mmt stability``, and what runs them."""
