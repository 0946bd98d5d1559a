"""Autoregressive models: Burg's method, line spectral frequencies, lattice filters."""

from typing import Annotated, Final

from annotated_types import Ge, Le

LARGEST_ORDER: Final = 64
"""The highest autoregressive order that a model may have; compiled code reserves memory for it."""

TINY: Final = 1e-300
"""Least divisor: it keeps quotients of powers finite."""

Order = Annotated[int, Ge(1), Le(LARGEST_ORDER)]
"""An autoregressive order; see `mmt.core.bounds`."""
