"""Methods beside the product's own: selection of samples, generators of vibration."""
