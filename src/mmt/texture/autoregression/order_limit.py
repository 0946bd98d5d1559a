"""The highest order of an autoregressive filter, for which compiled code reserves memory."""

from typing import Final

LARGEST_ORDER: Final = 64
"""The highest autoregressive order that a model may have."""
