"""Model-mediated teleoperation of haptic texture."""

__version__ = "0.1.0"
