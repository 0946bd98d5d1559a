"""A Universal Robots arm that is not there, behind the ports of its controller."""
