"""The ADXL335, an analogue accelerometer of three axes, behind a converter of some kind."""
