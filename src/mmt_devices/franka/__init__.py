"""Franka arms (FR3, Panda) through the library franky: robot and force sensor."""
