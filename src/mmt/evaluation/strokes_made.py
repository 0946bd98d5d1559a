"""The strokes that a hand made in a session, at which its models are judged."""

from collections.abc import Iterable
from typing import Final, Self

import numpy as np

from mmt.core.arrays import FloatArray, RecordArray
from mmt.evaluation.grid_errors import Strokes
from mmt.texture.settings import ModellingSettings
from mmt.texture.signals.aligned import AlignedBlock
from mmt.texture.signals.filtering import StreamFilter

MOST: Final = 400
"""Largest number of strokes to compare a model at: one each 50 ms of a session of 20 s."""

_EVERY_S: Final = 0.01  # a stroke changes little within it
_PERCENTILES: Final = (5.0, 95.0)


class StrokesMade:
    """Speed, force and heading of a tool while it strokes the surface, block by block.

    Parameters
    ----------
    settings
        Settings of the modelling; slower or lighter motion is no stroking.
    """

    def __init__(self, settings: ModellingSettings) -> None:
        self._settings = settings
        self._every = max(1, round(_EVERY_S * settings.rate_hz))
        self._seen = self._samples = 0
        self._parts: list[FloatArray] = []

    @classmethod
    def from_frames(cls, blocks: Iterable[RecordArray], settings: ModellingSettings) -> Self:
        """Return the strokes of frames, in blocks of shape (n,)."""
        made, stream = cls(settings), StreamFilter(settings)
        for block in blocks:
            made.add(stream.process(block))
        return made

    def add(self, motion: AlignedBlock) -> None:
        """Add the next block of filtered samples."""
        settings = self._settings
        stroking = motion.speed_mm_s >= settings.least_speed_mm_s
        stroking &= motion.normal_force_n >= settings.least_force_n
        chosen = np.flatnonzero(stroking)
        self._samples += len(chosen)
        chosen = chosen[(chosen + self._seen) % self._every == 0]
        self._seen += len(motion)
        heading = np.arctan2(motion.velocity_mm_s[chosen, 1], motion.velocity_mm_s[chosen, 0])
        rows = motion.speed_mm_s[chosen], motion.normal_force_n[chosen], heading
        self._parts.append(np.array(rows))

    @property
    def total_s(self) -> float:
        """Seconds of stroking so far."""
        return self._samples / self._settings.rate_hz

    def strokes(self, most: int = MOST) -> Strokes:
        """Return at most `most` strokes, evenly spread over the time of stroking."""
        rows = np.concatenate([np.empty((3, 0)), *self._parts], axis=1)
        count = min(most, rows.shape[1])
        chosen = ((np.arange(count) + 0.5) * rows.shape[1] / max(count, 1)).astype(np.int64)
        return Strokes(*rows[:, chosen])

    def ranges(self) -> tuple[tuple[float, float] | None, tuple[float, float] | None]:
        """Return the usual range of the speed (mm/s) and of the force (N), None without strokes."""
        rows = np.concatenate([np.empty((3, 0)), *self._parts], axis=1)[:2]
        if not rows.size:
            return None, None
        speed, force = np.percentile(rows, _PERCENTILES, axis=1).T.tolist()
        return tuple(speed), tuple(force)
