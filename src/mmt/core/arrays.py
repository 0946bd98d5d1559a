"""Array types shared by every layer."""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
"""Real-valued samples; the shape is given where it is used."""

IntArray = npt.NDArray[np.int64]
"""Indices and sequence numbers."""

BoolArray = npt.NDArray[np.bool_]
"""Masks."""

RecordArray = npt.NDArray[Any]
"""A structured array, such as a block of frames."""
