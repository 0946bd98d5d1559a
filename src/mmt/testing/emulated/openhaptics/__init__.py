"""Emulated Phantom and Touch devices, behind a library with the interface of libHD."""
