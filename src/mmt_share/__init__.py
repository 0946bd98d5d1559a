"""A model shared with listeners: what goes over the wire, who serves it, and who takes it."""
