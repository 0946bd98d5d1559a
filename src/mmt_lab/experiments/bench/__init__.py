"""The stages of ``mmt bench``, one module each."""
