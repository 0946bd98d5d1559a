"""What a hand can tell apart at the least."""

import math
from typing import Final

JND_DB: Final = 20.0 * math.log10(1.17)
"""Just noticeable difference of vibration, 17 % in amplitude (Awan et al., section VII.A)."""
