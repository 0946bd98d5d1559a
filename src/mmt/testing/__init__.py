"""Devices in software: a simulated robot, surface and hand, and emulated devices for drivers."""
