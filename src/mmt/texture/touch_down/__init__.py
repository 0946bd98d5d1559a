"""The transient of a touch-down: found in a stream, fitted, and rendered with a hand's own speed.

Event-based haptics: Kuchenbecker, Fiene and Niemeyer, "Improving contact realism through
event-based haptic feedback", IEEE Trans. Vis. Comput. Graph. 12 (2006), 219-230. Okamura, Cutkosky
and Dennerlein, "Reality-based models for vibration feedback in virtual environments", IEEE/ASME
Trans. Mechatronics 6 (2001), 245-252, fit one decaying sinusoid instead.
"""

from typing import Final

LEAST_RATE_HZ: Final = 5000.0
"""Least rate of the acceleration at which touch-downs are learnt and rendered."""

WINDOW_S: Final = 0.05
"""Length of a transient."""
