"""Franka arms (FR3, Panda) through the library franky: a robot that follows, and its own force."""
