"""Interface of another method's generator and its builder.

A package offers a builder, under a name of its own or as ``module:builder``. At each update the
builder gets the data that our modelling has so far, and returns a generator, or None as long as
there is too little data.

The generator is asked block by block, and keeps its own state from one block to the next.
``docs/how-to/add-a-generator.md`` says how to write a builder, with an example.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy.typing as npt

from mmt.texture.segmentation.segmenter import Segment
from mmt.texture.settings import Inputs
from mmt.texture.signals.aligned import AlignedBlock


@dataclass(frozen=True)
class Observed:
    """Data of a session up to an update, the same that our own modelling gets.

    Attributes
    ----------
    time_s
        Session time of the newest frame.
    rate_hz
        Sampling rate of the measured and the generated vibration, k times that of the frames.
    inputs
        ``"anisotropic"`` if the session's texture is modelled over velocity and force,
        ``"isotropic"`` if it is modelled over speed and force.
    samples
        Every frame so far, filtered: ``speed_mm_s`` (n,), ``velocity_mm_s`` (n, 2) in the plane
        of the surface, ``normal_force_n`` (n,), ``position_mm`` (n, 3), and ``vibration_m_s2``
        (n, k, 1), high-passed at 10 Hz, (n, k, 3) if three axes are modelled. ``index`` (n,)
        jumps where frames are missing; ``valid`` (n,) is False while filters settle.
    segments
        Stretches of the samples with nearly constant speed and force, to which models are fitted,
        the oldest first. Each has the means ``speed_mm_s``, ``velocity_mm_s`` (x, y) and
        ``force_n``, and ``vibration_m_s2`` (m,). The next update may replace a segment whose
        ``final`` is False.
    """

    time_s: float
    rate_hz: float
    inputs: Inputs
    samples: AlignedBlock
    segments: tuple[Segment, ...]


class VibrationGenerator(Protocol):
    """Generator that a builder returns.

    It may have an attribute ``directed``. If that is True, the generator is asked by velocity, even
    on a texture without a grain, on which strokes are along x. If ``directed`` is absent or False,
    it is asked by speed, whatever the texture.
    """

    @property
    def reset(self) -> Callable[[int], object]:
        """Start over: ``reset(seed)`` forgets earlier blocks; all chance comes from the seed."""

    @property
    def generate(self) -> Callable[..., npt.ArrayLike]:
        """Return the next block: ``generate(speed_mm_s, force_n)``, each (n,), gives (n,) in m/s2.

        If ``directed``, it is ``generate(velocity_x_mm_s, velocity_y_mm_s, force_n)``. The inputs
        have one number for each sample, in arrays that the generator may change. n may differ from
        block to block, and the output must not depend on n. Speed is 0 for a hand at rest, force
        for a hand off the surface; strokes may be faster and stronger than any before.
        """


Builder: TypeAlias = Callable[[Observed, VibrationGenerator | None], VibrationGenerator | None]
"""``build(observed, previous)`` returns a generator, or None as long as there is too little data.
``previous`` is its result for the last update of the same session, or None before the first; the
builder may extend that generator and return it again."""
