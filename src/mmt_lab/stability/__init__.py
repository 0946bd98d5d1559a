"""The stiff and extreme cases of ``mmt stability``, and the code that runs them."""
