"""Trials of any texture: whole sessions of a hand, segmented as the leader does, with knocks."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from mmt.core.arrays import BoolArray, FloatArray
from mmt.core.errors import InputError
from mmt.scene import Scene
from mmt.testing.simulation.offline import simulate_session
from mmt.testing.simulation.surfaces.known_surfaces import KnownSurface
from mmt.testing.simulation.surfaces.textures import get_surface
from mmt.texture.settings import ModellingSettings
from mmt.texture.space import InputSpace
from mmt_lab.harness.experiment import hand_of
from mmt_lab.selection.concatenated import segments_of
from mmt_lab.selection.knocks import RATE_HZ, add_knock, read_taps, simulated_knock
from mmt_methods.selection import ModelPoints

ORDER: Final = 12
SESSIONS: Final = 3
DURATION_S: Final = 18.0

_SHARE: Final = 0.1  # share of the segments that get a knock
_FEWEST: Final = 12


@dataclass(frozen=True)
class Trials:
    """Fitted strokes with knocks, the same ``without`` any, and which are ``knocked``, (n,)."""

    data: ModelPoints
    without: ModelPoints
    knocked: BoolArray
    surface: KnownSurface
    space: InputSpace


def session_trials(
    texture: str, hand: str, seed: int, generator: np.random.Generator, taps: Path | None = None
) -> Trials:
    """Return the fitted segments of three sessions of 18 s, a tenth of them with a knock.

    Parameters
    ----------
    texture, hand
        Name of a known texture, and kind of the hand.
    seed
        Seed of the sessions.
    generator
        Source of the knocks.
    taps
        Folder of the Penn toolkit's taps, from which all knocks are then taken: those on the
        texture's own material if the folder has them, else any.
    """
    surface = get_surface(texture)
    scene = Scene(hand=hand_of(hand, isotropic=surface.isotropic))
    settings = ModellingSettings(inputs="isotropic" if surface.isotropic else "anisotropic")
    segments = []
    for number in range(SESSIONS):
        frames, _ = simulate_session(scene, surface, DURATION_S, SESSIONS * seed + number)
        segments += segments_of(frames, settings)
    if len(segments) < _FEWEST:
        raise InputError(
            f"{texture}: the hand {hand} makes {len(segments)} steady strokes in {SESSIONS} "
            f"sessions, {_FEWEST} are needed; take another kind of hand"
        )
    space = InputSpace(settings.inputs)
    points = space.normalise(np.array([part.inputs(space) for part in segments]))
    vibration = [part.vibration_m_s2 for part in segments]
    knocked = np.zeros(len(segments), dtype=np.bool_)
    knocked[generator.choice(len(segments), round(_SHARE * len(segments)), replace=False)] = True
    knock = _knocks(texture, taps, generator)
    struck = [
        add_knock(part, knock(), generator) if hit else part
        for part, hit in zip(vibration, knocked.tolist(), strict=True)
    ]
    data, without = (
        ModelPoints.fitted(points, heard, ORDER, RATE_HZ) for heard in (struck, vibration)
    )
    return Trials(data, without, knocked, surface, space)


def _knocks(
    texture: str, taps: Path | None, generator: np.random.Generator
) -> Callable[[], FloatArray]:
    if taps is None:
        return lambda: simulated_knock(generator)
    material = Path(texture.partition("+")[0]).stem.removeprefix("Models_")
    own = taps / f"Taps_{material}.xml"
    files = [own] if own.exists() else sorted(taps.glob("Taps_*.xml"))
    if not files:
        raise InputError(f"--taps {taps}: no Taps_MATERIAL.xml is in this folder")
    found = [tap for file in files for tap in read_taps(file)]
    return lambda: found[int(generator.integers(len(found)))]
