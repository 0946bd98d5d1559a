"""Phantom and Touch devices through OpenHaptics HD: a robot that follows, a handle that leads."""
