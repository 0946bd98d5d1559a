"""Binary messages for a browser: a JSON header, then arrays that the page reads in place.

A message consists of the header's length (uint32), the header padded with spaces to a multiple
of four bytes, and the arrays in sequence; all numbers are little-endian, the arrays float32.
``arrays`` in the header lists name and shape of each. Encoding arrays as JSON text would take
about ten times as long.
"""

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from mmt.session.data import json_value


def pack(kind: str, header: Mapping[str, Any], arrays: Mapping[str, npt.ArrayLike]) -> bytes:
    """Encode one message.

    Parameters
    ----------
    kind
        Kind of message, for the page.
    header
        JSON values; numbers that are not finite become null.
    arrays
        Arrays of any shape, by name; values become float32.
    """
    packed = {name: np.ascontiguousarray(values, dtype="<f4") for name, values in arrays.items()}
    table = {
        "kind": kind,
        **header,
        "arrays": [[name, list(values.shape)] for name, values in packed.items()],
    }
    try:
        text = json.dumps(table, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(json_value(table), separators=(",", ":"), allow_nan=False)
    encoded = text.encode()
    encoded += b" " * (-len(encoded) % 4)
    return b"".join(
        [struct.pack("<I", len(encoded)), encoded, *(v.tobytes() for v in packed.values())]
    )


def header_of(message: bytes) -> Any:
    """Return the header of a message, with names and shapes in ``arrays``.

    Raises
    ------
    ValueError
        The bytes are not such a message.
    """
    return json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
