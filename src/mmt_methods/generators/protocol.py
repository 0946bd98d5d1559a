"""What a generator of another method is: what it is built from, and what it is asked for.

A package offers a builder, under a name of its own or as ``module:builder``. At each update the
builder gets what our modelling has then, and returns a generator, or None as long as there is
too little to make one.

The generator is asked block by block. What it needs from one block to the next, it keeps itself.
How to write one, with an example, is in ``docs/how-to/add-a-generator.md``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy.typing as npt

from mmt.texture.segmentation.segments import Segment
from mmt.texture.settings import Inputs
from mmt.texture.signals.aligned import AlignedBlock


@dataclass(frozen=True)
class Observed:
    """What there is of a session at an update: the same that our own modelling gets.

    Attributes
    ----------
    time_s
        Session time of the newest frame.
    rate_hz
        Sampling rate of the vibration that is measured and asked for, k times that of the frames.
    inputs
        ``"anisotropic"`` where the session's texture is modelled over velocity and force,
        ``"isotropic"`` where it is modelled over speed and force.
    samples
        Every frame so far, filtered: ``speed_mm_s`` (n,), ``velocity_mm_s`` (n, 2) in the plane
        of the surface, ``normal_force_n`` (n,), ``position_mm`` (n, 3), and ``vibration_m_s2``
        (n, k, 1), high-passed at 10 Hz, (n, k, 3) where three axes are modelled. ``index`` (n,)
        jumps where frames are missing; ``valid`` (n,) is False while filters settle.
    segments
        Stretches of these of nearly constant speed and force, that models are fitted to, in the
        order in which they came: means ``speed_mm_s``, ``velocity_mm_s`` (x, y) and ``force_n``,
        and ``vibration_m_s2`` (m,). One whose ``final`` is False may be replaced by the next
        update.
    """

    time_s: float
    rate_hz: float
    inputs: Inputs
    samples: AlignedBlock
    segments: tuple[Segment, ...]


class VibrationGenerator(Protocol):
    """What a builder returns.

    It may have an attribute ``directed``: True to be asked by velocity, also on a texture
    without a grain, where strokes are along x. Where it is absent or False it is asked by speed,
    whatever the texture.
    """

    @property
    def reset(self) -> Callable[[int], object]:
        """Begin anew: ``reset(seed)`` forgets the blocks before; all chance comes from the seed."""

    @property
    def generate(self) -> Callable[..., npt.ArrayLike]:
        """Return the next block: ``generate(speed_mm_s, force_n)``, each (n,), gives (n,) in m/s2.

        Where ``directed`` it is ``generate(velocity_x_mm_s, velocity_y_mm_s, force_n)``. The
        inputs are those of each sample, in arrays of its own. n may differ from block to block,
        and the sound must not depend on it. A hand at rest or off the surface comes as speed or
        force 0; strokes may be faster and stronger than any before.
        """


Builder: TypeAlias = Callable[[Observed, VibrationGenerator | None], VibrationGenerator | None]
"""``build(observed, previous)``: a generator of what was observed, None as long as there is too
little. ``previous`` is what it returned for the last update of the same session, None before; it
may be grown and returned again."""
