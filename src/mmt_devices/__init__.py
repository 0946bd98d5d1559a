"""Drivers for hardware that the papers do not use, each with an emulator."""
