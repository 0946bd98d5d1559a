"""Robots, sensors, interfaces and actuators, each behind one small protocol."""
