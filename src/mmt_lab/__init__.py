"""The laboratory: experiments that tell whether the product is any good."""
