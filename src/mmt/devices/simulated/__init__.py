"""Devices that need no hardware: a hand, a robot on a known texture, sensors, an actuator."""
