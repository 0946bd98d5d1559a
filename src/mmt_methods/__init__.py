"""Additional methods: selection of samples, and other generators of vibration."""
