"""A session as plain columns, for formats that hold no vectors."""

from typing import Any

import numpy as np

from mmt.core.frames import FIELD_OF_CHANNEL, Channel
from mmt.session.recorded import RecordedSession


def axis_columns(channel: Channel) -> tuple[str, str, str]:
    """Return the three column names of a channel, as in ``position_x_mm``."""
    unit = FIELD_OF_CHANNEL[channel].removeprefix(f"{channel}_")
    return (f"{channel}_x_{unit}", f"{channel}_y_{unit}", f"{channel}_z_{unit}")


def flat_columns(session: RecordedSession) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
    """Return ``sequence``, ``time_s`` and the axes of each channel, each of shape (n,)."""
    columns: dict[str, np.ndarray[Any, np.dtype[Any]]] = {
        "sequence": session.frames["sequence"],
        "time_s": session.time_s,
    }
    for channel in session.channels:
        vectors = session.frames[FIELD_OF_CHANNEL[channel]]
        for axis, name in enumerate(axis_columns(channel)):
            columns[name] = vectors[:, axis]
    return columns
