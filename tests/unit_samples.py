"""Units of what recordings hold, as people write them."""

UNITS = {
    "time": {
        "s": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "\u03bcs": 1e-6, "ns": 1e-9, "min": 60.0,
    },
    "position": {
        "mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3, "\u00b5m": 1e-3, "\u03bcm": 1e-3, "inch": 25.4,
        "in": 25.4, "ft": 304.8, "Micrometers": 1e-3, "MM": 1.0,
    },
    "force": {
        "N": 1.0, "mN": 1e-3, "cN": 1e-2, "kN": 1e3, "gf": 9.80665e-3, "kg": 9.80665,
        "lbs": 4.4482216152605, "lbf": 4.4482216152605, "oz": 0.27801385095378, "dyn": 1e-5,
    },
    "acceleration": {
        "m/s2": 1.0, "m/s^2": 1.0, "m/s\u00b2": 1.0, "cm/s2": 1e-2, "mm/s2": 1e-3, "g": 9.80665,
        "mg": 9.80665e-3, "Gal": 1e-2, "ft/s2": 0.3048, "m/s/s": 1.0,
    },
}  # fmt: skip
"""Factors to s, mm, N and m/s2 as the SI brochure and the international pound have them."""
FOREIGN = {"time": "V", "position": "deg", "force": "Nm", "acceleration": "counts"}
