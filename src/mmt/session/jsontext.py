"""JSON text that every reader accepts, made of whatever a program hands over."""

import json
import math

import numpy as np


def to_json(value: object) -> str:
    """Return a value as JSON text.

    NumPy scalars and arrays become numbers and lists, sets and tuples lists, numbers that
    JSON lacks (NaN, infinity) null, and every other object its text.
    """
    return json.dumps(_plain(value), allow_nan=False)


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float) else str(value)
