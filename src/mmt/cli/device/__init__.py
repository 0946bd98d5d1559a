"""``mmt device``: test, calibrate and equalise devices."""
