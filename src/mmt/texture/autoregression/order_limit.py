"""The highest order of an autoregressive filter, for which compiled code reserves memory."""

from typing import Annotated, Final

from annotated_types import Ge, Le

LARGEST_ORDER: Final = 64
"""The highest autoregressive order that a model may have."""

Order = Annotated[int, Ge(1), Le(LARGEST_ORDER)]
"""An autoregressive order; see `mmt.core.bounds`."""
