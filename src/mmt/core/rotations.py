"""Orientations of many frames: unit quaternions (n, 4), each (w, x, y, z)."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.core.frames import FIELD_OF_CHANNEL, Channel

_ONE: Final = np.eye(3)
_CROSS: Final = np.cross(_ONE[:, None], _ONE).transpose(0, 2, 1).reshape(3, 9)


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """Return the matrices (n, 3, 3) of the cross products with vectors (n, 3)."""
    return np.asarray(vectors @ _CROSS).reshape(-1, 3, 3)


def rotation_matrices(orientation: FloatArray) -> FloatArray:
    """Return the matrices (n, 3, 3) of unit quaternions (n, 4), by Rodrigues' formula."""
    crossed = cross_matrices(orientation[:, 1:])
    matrices: FloatArray = _ONE + 2.0 * (orientation[:, :1, None] * crossed + crossed @ crossed)
    return matrices


def turn_into_scene(frames: RecordArray, channels: Iterable[Channel]) -> None:
    """Turn channels of frames (n,) from the tool's axes by the frames' orientation, in place.

    All samples of acceleration in a frame are turned alike: at 5 rad/s those of its beginning are
    off by 0.3 degrees. A frame takes some 20 us.
    """
    turns = rotation_matrices(frames["orientation"].astype(np.float64))
    for channel in channels:
        field = frames[FIELD_OF_CHANNEL[channel]]
        vectors = field.reshape(len(frames), -1, 3)
        field[...] = (vectors @ turns.transpose(0, 2, 1)).reshape(field.shape)


def without_flips(quaternions: FloatArray) -> FloatArray:
    """Return quaternions (n, 4) of norm 1, each on the side of the one before, to interpolate."""
    norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    opposite = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    signs = np.cumprod(np.where(opposite, -1.0, 1.0))
    unflipped: FloatArray = quaternions / norms * np.concatenate([[1.0], signs])[:, None]
    return unflipped
