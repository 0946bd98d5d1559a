"""A model's file as plain arrays, by which models are passed on without compiled code."""

import io
from typing import Any, Final

import numpy as np

from mmt.core.errors import InputError
from mmt.core.files.untrusted import load_arrays
from mmt.texture.settings import CHANNELS

Arrays = dict[str, Any]
"""The arrays of a file by name."""

MODEL_ROWS: Final = (
    *dict.fromkeys(channel for channels in CHANNELS.values() for channel in channels),
    *("lsf_rad", "variance", "power", "effective_samples", "segment_samples"),
)
"""Arrays with a row for each sample."""

FIELD_ROWS: Final = ("field_cells", "field_sums")
"""Arrays with a row for each cell of the field."""


def pack_arrays(arrays: Arrays) -> bytes:
    """Return the content of the file that holds these arrays, by name."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def file_arrays(data: bytes) -> Arrays:
    """Return the arrays of a file by name, unchecked.

    Raises
    ------
    InputError
        The data is no archive of arrays.
    """
    try:
        return dict(load_arrays(data)[0])
    except (InputError, OSError) as error:
        raise InputError("not a texture model (.npz), or cut off") from error
