"""Drivers of the ADXL335, an analogue accelerometer of three axes, behind an A/D converter."""
