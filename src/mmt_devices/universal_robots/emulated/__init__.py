"""Emulated Universal Robots arm, behind the ports of its controller."""
