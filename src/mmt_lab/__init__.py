"""The laboratory: experiments that measure how good the product is."""
